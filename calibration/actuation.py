"""What a calibration says of a patch: acceleration per volt of strain, and volts for a strain.

Drives are planned in strain (volts without the patch's hysteresis), because in strain the table is
linear; `commanded` takes a strain back to the volts that make it.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.ndimage import uniform_filter1d

from calibration.model import Model
from calibration.record import Calibration
from calibration.response import Response
from instruments import DataError, Limits
from instruments.arrays import ComplexArray, FloatArray

__all__ = [
    "binding",
    "commanded",
    "density",
    "doubt",
    "gain",
    "measured_well",
    "path_gain",
    "ringing",
    "room",
]

_SETTLED = 0.2
"""Seconds in which what a coupling capacitor adds to the end of a drive has gone."""

_SMOOTH_HZ = 2.5
_LEAST_COHERENCE = 0.8


def gain(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """m/s^2 per V of strain commanded, at `f` (Hz).

    The model averages the sweeps' noise, and holds the lag that hysteresis has at the sweeps'
    level: it is taken out. The path's gain is left out as well, because it acts before the
    hysteresis; its delay may stay, because hysteresis does not depend on time.
    """
    response = calibration.response
    path = _path(response, f) / (path_gain(calibration) * calibration.hysteresis.gain(response.level))
    return np.asarray(calibration.model.velocity(f) * 2j * np.pi * f * path)


def doubt(calibration: Calibration, f: FloatArray) -> FloatArray:
    """Standard deviation of `gain`: what the model leaves of the measured response.

    It is averaged over a few lines first, as the model averages over all of them: what changes from
    line to line is the sweeps' noise and the harmonics of the patch, and no fault of the model.
    """
    response = calibration.response
    left = response.velocity - calibration.model.velocity(response.frequencies)
    lines = max(1, round(_SMOOTH_HZ / float(np.median(np.diff(response.frequencies)))))
    smooth = uniform_filter1d(left.real, lines) + 1j * uniform_filter1d(left.imag, lines)
    return np.asarray(np.sqrt(np.mean(np.abs(smooth) ** 2)) * 2 * np.pi * f)


def density(calibration: Calibration, f: FloatArray) -> FloatArray:
    """Acceleration noise of one play (m/s^2 per sqrt(Hz), one-sided) at `f` (Hz)."""
    response = calibration.response
    if not len(response.noise):  # imported: nobody said
        return np.zeros(len(f))
    return np.asarray(np.interp(f, response.frequencies, response.noise) * 2 * np.pi * f)


def path_gain(calibration: Calibration) -> float:
    """Measured volts at the patch per volt commanded."""
    return float(np.median(np.abs(calibration.response.path)))


def ringing(model: Model) -> float:
    """Seconds after which the slowest mode has fallen to a hundredth, 0.3 to 2."""
    slowest = min(2 * np.pi * r.frequency_hz * r.damping for r in model.resonances)
    return float(np.clip(np.log(100) / slowest, 0.3, 2.0))


def measured_well(response: Response, band: tuple[float, float]) -> tuple[float, float]:
    """What of `band` (Hz) lies between the first and last frequency with a coherence of 0.8 or more.

    Raises DataError when nothing does.
    """
    known = response.coherence if len(response.coherence) else np.ones(len(response.frequencies))
    good = response.frequencies[known >= _LEAST_COHERENCE]
    low, high = (max(band[0], good[0]), min(band[1], good[-1])) if len(good) else (1.0, 0.0)
    if low >= high:
        raise DataError(
            f"The response of patch {response.patch} at the {response.point} point is too noisy for a "
            f"drive between {band[0]:g} and {band[1]:g} Hz: its coherence is "
            f"{float(known.max()):.2f} at best, and {_LEAST_COHERENCE} is needed."
        )
    return float(low), float(high)


def commanded(calibration: Calibration, strain: FloatArray, smooth: FloatArray) -> FloatArray:
    """(samples,) V to command for a strain ((samples,) V), with zero mean and zero ends.

    `smooth` (samples,) is a window that falls to zero at both ends.
    """
    volts = calibration.hysteresis.volts(strain) / path_gain(calibration)
    # A strain of zero may be left with volts that hysteresis holds; they fade out at the end.
    half = len(volts) // 2
    volts[half:] -= volts[-1] * (1 - smooth[half:])
    volts -= smooth * (volts.sum() / smooth.sum())
    return volts


def room(calibration: Calibration, volts: FloatArray, limits: Limits) -> float:
    """The largest factor that keeps commanded volts within every limit, at the patch as well."""
    return min(share for share, _ in _shares(calibration, volts, limits))


def binding(calibration: Calibration, volts: FloatArray, limits: Limits) -> str:
    """Which limit leaves the least room, in words."""
    return min(_shares(calibration, volts, limits))[1]


def _shares(calibration: Calibration, volts: FloatArray, limits: Limits) -> list[tuple[float, str]]:
    rate_hz = calibration.rate_hz
    shares = []
    # Limits hold for the volts commanded and for those that reach the patch.
    for there in (volts, _arriving(calibration.response, volts, rate_hz)):
        steps = np.abs(np.diff(there, prepend=0.0, append=0.0)) * rate_hz
        current = limits.capacitance * steps
        for value, limit, what in (
            (float(np.abs(there).max()), limits.peak, f"{limits.peak:.1f} V at the patch"),
            (float(steps.max()), limits.slew, f"{limits.slew:.3g} V/s at the patch"),
            (float(current.max()), limits.current_peak, f"{limits.current_peak:.3g} A into the patch"),
            (
                float(current.mean()) / 2,
                limits.current_average,
                f"{limits.current_average:.3g} A on average into the patch",
            ),
        ):
            if value > 0:
                shares.append((limit / value, what))
    return shares


def _arriving(response: Response, volts: FloatArray, rate_hz: float) -> FloatArray:
    """(samples,) V that reach the patch, by the measured path.

    An output that is coupled by a capacitor, as a sound card's is, turns phases below 100 Hz, and may make
    of the same amplitudes a higher peak.
    """
    length = next_fast_len(len(volts) + round(_SETTLED * rate_hz), real=True)
    f = rfftfreq(length, 1 / rate_hz)
    return np.asarray(irfft(rfft(volts, length) * _path(response, f), length)[: len(volts)])


def _path(response: Response, f: FloatArray) -> ComplexArray:
    """Measured volts at the patch per volt commanded, at `f` (Hz)."""
    return np.asarray(np.interp(f, response.frequencies, response.path))
