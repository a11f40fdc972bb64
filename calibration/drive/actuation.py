"""Actuation model of a calibrated patch: acceleration per linear volt, and volts for linear volts.

Drives are planned in linear volts (the volts that would produce the same motion without the patch's
hysteresis), because the table is linear in them; `commanded` converts them to volts to command.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.ndimage import uniform_filter1d

from haploop.calibration.model import Calibration, Model
from haploop.calibration.response import Response
from haploop.instruments import DataError, Limits
from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = [
    "binding",
    "commanded",
    "density",
    "gain",
    "headroom",
    "measured_well",
    "path_gain",
    "ringing",
    "uncertainty",
]

_SETTLED = 0.2
"""Seconds in which the decay that a coupling capacitor adds to the end of a drive dies out."""

_SMOOTH_HZ = 2.5
_LEAST_COHERENCE = 0.8


def gain(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """m/s^2 per linear volt commanded, at `f` (Hz).

    The model averages the sweeps' noise and contains the lag of hysteresis at the sweeps' level;
    that lag is removed. The path's gain is left out as well, because it acts before the
    hysteresis; its delay may stay, because hysteresis does not depend on time.
    """
    response = calibration.response
    path = _path(response, f) / (path_gain(calibration) * calibration.hysteresis.gain(response.level))
    return np.asarray(calibration.model.velocity(f) * 2j * np.pi * f * path)


def uncertainty(calibration: Calibration, f: FloatArray) -> FloatArray:
    """Standard deviation of `gain`: the residual of the model against the measured response.

    The residual is averaged over a few lines first, as the model averages over all of them: variation
    from line to line is the sweeps' noise and the patch's harmonics, not a model error.
    """
    response = calibration.response
    residual = response.velocity - calibration.model.velocity(response.frequencies)
    lines = max(1, round(_SMOOTH_HZ / float(np.median(np.diff(response.frequencies)))))
    smooth = uniform_filter1d(residual.real, lines) + 1j * uniform_filter1d(residual.imag, lines)
    return np.asarray(np.sqrt(np.mean(np.abs(smooth) ** 2)) * 2 * np.pi * f)


def density(calibration: Calibration, f: FloatArray) -> FloatArray:
    """Acceleration noise of one play (m/s^2 per sqrt(Hz), one-sided) at `f` (Hz)."""
    response = calibration.response
    if not len(response.noise):  # imported without noise data
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
    """The part of `band` (Hz) between the first and last frequency with a coherence of 0.8 or more.

    Raises DataError when there is none.
    """
    coherence = response.coherence if len(response.coherence) else np.ones(len(response.frequencies))
    good = response.frequencies[coherence >= _LEAST_COHERENCE]
    low, high = (max(band[0], good[0]), min(band[1], good[-1])) if len(good) else (1.0, 0.0)
    if low >= high:
        raise DataError(
            f"The response of patch {response.patch} at the {response.point} point is too noisy for a "
            f"drive between {band[0]:g} and {band[1]:g} Hz: its coherence is "
            f"{float(coherence.max()):.2f} at best, and {_LEAST_COHERENCE} is needed."
        )
    return float(low), float(high)


def commanded(calibration: Calibration, linear_volts: FloatArray, smooth: FloatArray) -> FloatArray:
    """(samples,) V to command for (samples,) linear volts, with zero mean and zero ends.

    `smooth` (samples,) is a window that falls to zero at both ends.
    """
    volts = calibration.hysteresis.from_linear_volts(linear_volts) / path_gain(calibration)
    # At zero linear volts, hysteresis may leave a residual voltage; it fades out at the end.
    half = len(volts) // 2
    volts[half:] -= volts[-1] * (1 - smooth[half:])
    volts -= smooth * (volts.sum() / smooth.sum())
    return volts


def headroom(calibration: Calibration, volts: FloatArray, limits: Limits) -> float:
    """The largest factor that keeps commanded volts within every limit, at the patch as well."""
    return min(factor for factor, _ in _headrooms(calibration, volts, limits))


def binding(calibration: Calibration, volts: FloatArray, limits: Limits) -> str:
    """The limit with the least headroom, in words."""
    return min(_headrooms(calibration, volts, limits))[1]


def _headrooms(calibration: Calibration, volts: FloatArray, limits: Limits) -> list[tuple[float, str]]:
    rate_hz = calibration.rate_hz
    factors = []
    # Limits hold for the volts commanded and for those that reach the patch.
    for waveform in (volts, _arriving(calibration.response, volts, rate_hz)):
        steps = np.abs(np.diff(waveform, prepend=0.0, append=0.0)) * rate_hz
        current = limits.capacitance * steps
        for value, limit, description in (
            (float(np.abs(waveform).max()), limits.peak, f"{limits.peak:.1f} V at the patch"),
            (float(steps.max()), limits.slew, f"{limits.slew:.3g} V/s at the patch"),
            (float(current.max()), limits.current_peak, f"{limits.current_peak:.3g} A into the patch"),
            (
                float(current.mean()) / 2,
                limits.current_average,
                f"{limits.current_average:.3g} A on average into the patch",
            ),
        ):
            if value > 0:
                factors.append((limit / value, description))
    return factors


def _arriving(response: Response, volts: FloatArray, rate_hz: float) -> FloatArray:
    """(samples,) V that reach the patch, by the measured path.

    An AC-coupled output, such as a sound card's, shifts phases below 100 Hz, which can raise the peak at
    equal amplitudes.
    """
    length = next_fast_len(len(volts) + round(_SETTLED * rate_hz), real=True)
    f = rfftfreq(length, 1 / rate_hz)
    return np.asarray(irfft(rfft(volts, length) * _path(response, f), length)[: len(volts)])


def _path(response: Response, f: FloatArray) -> ComplexArray:
    """Measured volts at the patch per volt commanded, at `f` (Hz)."""
    return np.asarray(np.interp(f, response.frequencies, response.path))
