"""Levels of a vibration above the threshold of detection, over time and in third octaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.filters import fast_length
from ..intervals import LEAST_PLAYS, common, not_negative, quantile
from .thresholds import REFERENCE, thresholds

SHORT = 0.02
"""Window (s) in which a level is drawn over time. It shows a snap, and is not judged by."""
OCTAVES = 1000.0 * 10.0 ** (np.arange(-17, 1) / 10)
"""(bands,) Hz: exact centres of the third octaves from 20 to 1000 Hz (IEC 61260-1:2014)."""
_HALF = 10.0**0.05
_ENOUGH_HZ = 4000.0
"""Sample rate (samples/s) that is enough for energies of what is felt, up to 1122 Hz."""
_PAD = 0.2
"""Silence (s) appended before filtering."""

Sensitivity = Callable[[FloatArray], FloatArray]
"""Threshold (dB re 1e-6 m/s^2 rms) as a function of frequency (Hz)."""


def resting(frequencies: FloatArray) -> FloatArray:
    """Threshold (dB re 1e-6 m/s^2 rms) of a finger at rest; infinite outside 17.8 to 1122 Hz."""
    return _within(frequencies, thresholds().act("resting").level(frequencies))


def pressing(frequencies: FloatArray) -> FloatArray:
    """Threshold (dB re 1e-6 m/s^2 rms) of a finger that presses, by the table; otherwise as `resting`."""
    return _within(frequencies, thresholds().act("pressing").level(frequencies))


@dataclass(frozen=True, eq=False)
class Levels:
    """Levels of a signal in the loudest window as long as the bursts of the thresholds (1 s).

    A tone at threshold that fills the window has 0 dB; a short event counts by its energy.
    """

    pressing: float
    """Energy weighted with the threshold of a finger that presses (dB above it)."""
    resting: float
    """The same for a finger at rest, in the window in which that is largest."""
    bands: FloatArray
    """(bands,) dB re 1e-6 m/s^2 rms in the third octaves of `OCTAVES`, in the window of `pressing`."""
    estimated: float
    """Share of the weighted energy above the highest frequency whose threshold was found."""
    interval: tuple[float, float]
    """95 % confidence interval of `pressing`, from several plays; of one signal both ends are that."""

    def lowered(self, shift: float) -> Levels:
        """The levels above a pressing threshold that lies `shift` (dB) higher."""
        low, high = self.interval
        return replace(self, pressing=self.pressing - shift, interval=(low - shift, high - shift))


def levels_of(signal: FloatArray, rate_hz: float) -> Levels:
    """Levels of an acceleration (samples,) m/s^2: mean squares over the window's full length.

    Of (plays, samples), three or more, it is what the plays have in common: their noise is in no level.
    """
    table = thresholds()
    spectrum = _Spectrum.of(signal, rate_hz).coarse(rate_hz)
    rate_hz *= spectrum.samples / signal.shape[-1]
    f = spectrum.frequencies
    pressed = spectrum.filtered(_weight(f, pressing))
    energy = _running(_shared(pressed), rate_hz, table.burst)
    end, count = int(np.argmax(energy)), _length(rate_hz, table.burst)
    part = slice(max(end - count, 0), end)
    known = f <= table.act("pressing").curve.found_to_hz
    guessed = spectrum.filtered(np.where(known, 0.0, _weight(f, pressing)))
    inside = [_shared(spectrum.filtered(_band(f, index)))[part] for index in range(len(OCTAVES))]
    whole = float(np.sum(_shared(pressed)[part]))
    rested = _running(_shared(spectrum.filtered(_weight(f, resting))), rate_hz, table.burst)
    return Levels(
        pressing=decibels(float(energy[end])),
        resting=decibels(float(rested.max())),
        bands=np.array([decibels(float(np.sum(one)) / count / REFERENCE**2) for one in inside]),
        estimated=float(np.clip(np.sum(_shared(guessed)[part]) / whole, 0, 1)) if whole > 0 else 0.0,
        interval=_interval(pressed[..., part], float(energy[end]), count),
    )


def event_levels(signal: FloatArray, rate_hz: float, begin: float, window: float, count: int) -> FloatArray:
    """(count,) dB above the pressing threshold of the energy in each `window` (s) from `begin` (s) on.

    Each counts as an event of its own: its energy over that of a burst at threshold. Of (plays, samples) it
    is what the plays have in common, and nothing where that is below its standard deviation.
    """
    spectrum = _Spectrum.of(signal, rate_hz)
    pressed = np.atleast_2d(spectrum.filtered(_weight(spectrum.frequencies, pressing)))
    edges = np.rint((begin + window * np.arange(count + 1)) * rate_hz).astype(int)
    edges = np.clip(edges, 0, pressed.shape[1])
    energy = np.array([_event(pressed[:, a:b]) for a, b in pairwise(edges)])
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(energy / rate_hz / thresholds().burst))


def mean_levels(signal: FloatArray, rate_hz: float) -> tuple[FloatArray, float]:
    """Levels over the whole record: (bands,) dB re 1e-6 m/s^2 rms, and dB above the pressing threshold."""
    spectrum = _Spectrum.of(signal, rate_hz)
    f = spectrum.frequencies
    bands = [spectrum.energy(_band(f, index)) / REFERENCE**2 for index in range(len(OCTAVES))]
    return np.array([decibels(band) for band in bands]), decibels(spectrum.energy(_weight(f, pressing)))


def running_level(signal: FloatArray, rate_hz: float, window: float) -> FloatArray:
    """(samples,) dB above the pressing threshold of the energy in the `window` (s) around each sample.

    Of (plays, samples) it is what the plays have in common.
    """
    spectrum = _Spectrum.of(signal, rate_hz)
    energy = _running(_shared(spectrum.filtered(_weight(spectrum.frequencies, pressing))), rate_hz, window)
    half = _length(rate_hz, window) // 2
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(np.maximum(energy[half : half + spectrum.samples], 0.0)))


def spans_above(above: np.ndarray, rate_hz: float) -> tuple[tuple[float, float], ...]:
    """Begin and end (s) of each run of true samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], above.astype(np.int8), [0]])))
    return tuple((float(a) / rate_hz, float(b) / rate_hz) for a, b in edges.reshape(-1, 2))


def decibels(energy: float) -> float:
    """Level (dB) of an energy ratio; minus infinity for none."""
    return float(10 * np.log10(energy)) if energy > 0 else -np.inf


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """Spectrum of a signal with silence appended, so that nothing wraps around when it is filtered."""

    lines: ComplexArray
    frequencies: FloatArray
    samples: int
    """Length of the signal."""
    length: int
    """Length with the silence."""

    @classmethod
    def of(cls, signal: FloatArray, rate_hz: float) -> _Spectrum:
        samples = signal.shape[-1]
        length = fast_length(samples + round(_PAD * rate_hz))
        return cls(
            np.asarray(np.fft.rfft(signal, length)),
            np.asarray(np.fft.rfftfreq(length, 1 / rate_hz)),
            samples,
            length,
        )

    def coarse(self, rate_hz: float) -> _Spectrum:
        """The same at a lower sample rate than `rate_hz`, one that is enough for what is felt."""
        factor = int(rate_hz // _ENOUGH_HZ)
        if factor < 2:
            return self
        length = -(-self.length // factor)
        kept = length // 2 + 1
        samples = round(self.samples * length / self.length)
        return _Spectrum(
            self.lines[..., :kept] * (length / self.length), self.frequencies[:kept], samples, length
        )

    def filtered(self, gain: FloatArray) -> FloatArray:
        """(..., samples) without delay; `gain` is (lines,)."""
        return np.asarray(np.fft.irfft(self.lines * gain, self.length)[..., : self.samples])

    def energy(self, gain: FloatArray) -> float:
        """Mean square over the signal's own length; `gain` is (lines,)."""
        return float(2 * np.sum(np.abs(self.lines * gain) ** 2) / self.length / self.samples)


def _weight(frequencies: FloatArray, threshold: Sensitivity) -> FloatArray:
    """(lines,) gain to units of the threshold: an rms of one is 0 dB."""
    return np.asarray(10 ** (-threshold(frequencies) / 20) / REFERENCE)


def _edges(side: int) -> FloatArray:
    return np.asarray(OCTAVES * _HALF**side)


def _band(frequencies: FloatArray, index: int) -> FloatArray:
    inside = (frequencies >= _edges(-1)[index]) & (frequencies < _edges(+1)[index])
    return np.where(inside, 1.0, 0.0)


def _within(frequencies: FloatArray, levels: FloatArray) -> FloatArray:
    return np.where((frequencies >= _edges(-1)[0]) & (frequencies < _edges(+1)[-1]), levels, np.inf)


def _length(rate_hz: float, window: float) -> int:
    return max(1, round(window * rate_hz))


def _shared(signals: FloatArray) -> FloatArray:
    """(samples,) power: of one signal, or what (plays, samples) have in common, by their products."""
    if signals.ndim == 1:
        return np.asarray(signals**2)
    plays = len(signals)
    if plays < LEAST_PLAYS:
        return np.asarray(signals.mean(axis=0) ** 2)
    return np.asarray((signals.sum(axis=0) ** 2 - (signals**2).sum(axis=0)) / (plays * (plays - 1)))


def _interval(signals: FloatArray, energy: float, count: int) -> tuple[float, float]:
    """95 % confidence interval (dB) of the energy in a window of `count` samples of (plays, samples)."""
    if signals.ndim == 1 or len(signals) < LEAST_PLAYS:
        return decibels(energy), decibels(energy)
    value, deviation = common(signals @ signals.T / count)
    low, high = not_negative(value, quantile(len(signals)) * deviation)
    return decibels(low), decibels(high)


def _event(signals: FloatArray) -> float:
    """Energy of (plays, samples) in common: zero where it is below its deviation."""
    if len(signals) < LEAST_PLAYS:
        return float(np.sum(signals.mean(axis=0) ** 2))
    value, deviation = common(signals @ signals.T)
    return value if value > deviation else 0.0


def _running(power: FloatArray, rate_hz: float, window: float) -> FloatArray:
    """(samples + window + 1,) mean power over the `window` (s) that ends before each sample."""
    count = _length(rate_hz, window)
    sums = np.concatenate([[0.0], np.cumsum(np.pad(power, count))])
    return np.asarray((sums[count:] - sums[:-count]) / count)
