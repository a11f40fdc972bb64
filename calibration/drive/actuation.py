"""Actuation model of a calibrated patch: acceleration per linear volt, and volts for linear volts.

Drives are planned in linear volts (the volts that would produce the same motion without the patch's
hysteresis), because the table is linear in them; `commanded` converts them to volts to command.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import scipy

from ...instruments import DataError, Limits
from ...instruments.arrays import ComplexArray, FloatArray
from ..model import Calibration, Model, standard_deviation
from ..response import Response

__all__ = [
    "commanded",
    "gain",
    "headroom",
    "known",
    "measured_well",
    "path_gain",
    "ringing",
    "uncertainty",
]

_SETTLED = 0.2
"""Seconds in which the decay that a coupling capacitor adds to the end of a drive dies out."""

_LEAST_COHERENCE = 0.8

_Values = TypeVar("_Values", FloatArray, ComplexArray)


def gain(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """m/s^2 per linear volt commanded, at `f` (Hz) within what is `known`.

    The model averages the sweeps' noise and contains the lag of hysteresis at the sweeps' level;
    that lag is removed. The path's gain is left out as well, because it acts before the
    hysteresis; its delay may stay, because hysteresis does not depend on time. Beyond the model's band it is
    the measured response itself.
    """
    velocity = _joined(calibration, f, calibration.model.velocity(f), lambda above: above.velocity)
    lag = path_gain(calibration) * calibration.hysteresis.gain(calibration.response.level)
    return np.asarray(velocity * 2j * np.pi * f * _path(calibration, f) / lag)


def known(calibration: Calibration) -> tuple[float, float]:
    """Lowest and highest frequency (Hz) at which the response was measured."""
    low, high = calibration.model.band
    above = calibration.above
    return low, high if above is None else float(above.frequencies[-1])


def uncertainty(calibration: Calibration, f: FloatArray) -> FloatArray:
    """Standard deviation of `gain`: that of the model, and beyond its band of the measured response."""
    low, high = calibration.model.band
    inside = standard_deviation(calibration, np.clip(f, low, high))
    deviation = _joined(calibration, f, inside, lambda above: above.deviation)
    return np.asarray(deviation * 2 * np.pi * f)


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


def headroom(calibration: Calibration, volts: FloatArray, limits: Limits) -> tuple[float, str]:
    """The largest factor that keeps commanded volts within every limit, and the binding limit in words.

    Limits hold for the volts commanded and for those that reach the patch.
    """
    waveforms = (volts, _arriving(calibration, volts))
    return min(limits.headroom(waveform, calibration.rate_hz) for waveform in waveforms)


def _arriving(calibration: Calibration, volts: FloatArray) -> FloatArray:
    """(samples,) V that reach the patch, by the measured path.

    An AC-coupled output, such as a sound card's, shifts phases below 100 Hz, which can raise the peak at
    equal amplitudes.
    """
    rate_hz = calibration.rate_hz
    length = scipy.fft.next_fast_len(len(volts) + round(_SETTLED * rate_hz), real=True)
    f = scipy.fft.rfftfreq(length, 1 / rate_hz)
    return np.asarray(
        scipy.fft.irfft(scipy.fft.rfft(volts, length) * _path(calibration, f), length)[: len(volts)]
    )


def _path(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """Measured volts at the patch per volt commanded, at `f` (Hz)."""
    response = calibration.response
    inside = np.interp(f, response.frequencies, response.path)
    return _joined(calibration, f, inside, lambda above: above.path)


def _joined(
    calibration: Calibration, f: FloatArray, inside: _Values, of: Callable[[Response], _Values]
) -> _Values:
    """`inside`, given at `f` (Hz); beyond the middle of what both cover, a quantity of the response above."""
    above = calibration.above
    if above is None:
        return inside
    edge = (calibration.model.band[1] + above.frequencies[0]) / 2
    return np.asarray(np.where(f > edge, np.interp(f, above.frequencies, of(above)), inside))
