"""Filters of recorded signals: a running mean, the high-pass, and the undoing of a sensor's low-pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import DataError
from ...base.filters import fast_length, without_phase
from ...base.parts import Parted
from ...instruments import LinearSensor
from ..recording import Recording

_PERIODS = 5.0
"""Periods of a cut-off after which a Butterworth filter of second order has died out, to 1e-9."""
_RIPPLE = 1e-4
"""Added to the power response before division: limits the gain to 50, and makes a gain of 10 come out 1 %
low."""


def running_mean(signal: FloatArray, size: int) -> FloatArray:
    """Mean of a signal (samples,) over `size` samples about each, mirrored at the ends.

    Not by running sums, which leave rounding on a plateau; and scipy.ndimage would load for 0.15 s in the
    middle of a session.
    """
    return _mean(signal, size, (size // 2, size - 1 - size // 2)) if len(signal) else signal


def smoothed(signal: Parted, size: int) -> Parted:
    """`running_mean` of a signal (samples,), part by part."""
    before, after = size // 2, size - 1 - size // 2

    def make(part: slice) -> FloatArray:
        low, high = part.start - before, part.stop + after
        near = signal[max(0, low) : high]
        return _mean(near, size, (max(0, -low), max(0, high - len(signal))))

    return Parted(signal.shape, np.float64, make)


@dataclass(frozen=True, eq=False)
class Above:
    """A signal (samples,) above a rest."""

    signal: Parted
    rest: float

    def __getitem__(self, within: slice) -> FloatArray:
        return self.signal[within] - self.rest


def _mean(signal: FloatArray, size: int, mirrored: tuple[int, int]) -> FloatArray:
    """Means over `size` samples, with so many mirrored ones before and after."""
    return np.convolve(np.pad(signal, mirrored, mode="symmetric"), np.full(size, 1 / size), "valid")


def high_pass(acceleration: FloatArray, rate_hz: float, cutoff_hz: float = 10.0) -> FloatArray:
    """High-pass (..., samples) at `cutoff_hz` with zero phase.

    A second-order Butterworth filter (bilinear transform), forwards and backwards: -6 dB at the cut-off. The
    signal is extended by 0.5 s at both ends; without that, 2 % of it remains there (measured). Raises
    DataError for a single sample, and for a cut-off of half the rate or more.
    """
    if acceleration.shape[-1] < 2:
        raise DataError(f"A signal of {acceleration.shape[-1]} samples cannot be filtered.")
    if not 0 < cutoff_hz < rate_hz / 2:
        raise DataError(f"A high-pass at {cutoff_hz:g} Hz needs more than {2 * cutoff_hz:g} samples/s.")

    def gain(f: FloatArray) -> FloatArray:
        passed = np.tan(np.pi * np.minimum(f / rate_hz, 0.4999)) ** 4
        return np.asarray(passed / (passed + np.tan(np.pi * cutoff_hz / rate_hz) ** 4))

    return without_phase(acceleration, rate_hz, gain, 0.5, _PERIODS / cutoff_hz)


def _restoring(recording: Recording, band: tuple[float, float], frequencies: FloatArray) -> ComplexArray:
    """Compute the filter that undoes the sensor's low-pass in a band, at `frequencies` (Hz)."""
    response = _sensor(recording).response(frequencies)
    inverse = np.conj(response) / (np.abs(response) ** 2 + _RIPPLE)
    octaves = np.log2(np.maximum(frequencies, 1e-9))
    outside = np.maximum(np.log2(band[0]) - octaves, octaves - np.log2(band[1]))
    share = np.cos(np.pi / 2 * np.clip(3 * outside, 0, 1)) ** 2
    return np.asarray(1 + share * (inverse - 1))


def undone(recording: Recording, acceleration: FloatArray, band: tuple[float, float]) -> FloatArray:
    """Undo the sensor's low-pass within a band of an acceleration (samples,)."""
    # FFT filtering is circular: a second of edge padding keeps one end out of the other.
    pad = round(recording.rate_hz)
    padded = np.pad(acceleration, pad, mode="edge")
    length = fast_length(len(padded))
    frequencies = np.asarray(np.fft.rfftfreq(length, 1 / recording.rate_hz))
    spectrum = np.fft.rfft(padded, length) * _restoring(recording, band, frequencies)
    return np.asarray(np.fft.irfft(spectrum, length)[pad : pad + len(acceleration)])


def noise_gain(recording: Recording, band: tuple[float, float]) -> float:
    """Compute `Representative.noise_gain`."""
    frequencies = np.linspace(0, recording.rate_hz / 2, 5001)
    return float(np.sqrt(np.mean(np.abs(_restoring(recording, band, frequencies)) ** 2)))


def _sensor(recording: Recording) -> LinearSensor:
    assert recording.motion is not None
    return recording.sensors.linear[recording.motion]


def bandwidth_of(recording: Recording) -> float:
    """Corner of the sensor of motion (Hz), half the rate it was measured at at most; infinite without one."""
    if recording.motion is None:
        return np.inf
    return min(_sensor(recording).bandwidth_hz, recording.measured_hz / 2)
