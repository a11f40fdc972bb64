"""Band-limited signals: operations shared by drive and check, so that both use the same band edges."""

from __future__ import annotations

import numpy as np

from ..base.arrays import FloatArray, IntArray


def fade(samples: int, rise: int, fall: int) -> FloatArray:
    """Window (samples,) that rises to one over the first `rise` samples and falls over the last `fall`."""
    window = np.ones(samples)
    window[:rise] = 0.5 - 0.5 * np.cos(np.pi * np.arange(rise) / max(rise, 1))
    window[samples - fall :] = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fall + 1) / max(fall, 1))
    return window


def band_window(frequencies: FloatArray, low: float, high: float, outside: bool = False) -> FloatArray:
    """Weights of `frequencies` (Hz): one within the band and zero beyond, with cosine edges.

    The edges lie inside `low` to `high`, or with `outside` just beyond: a signal already cut to the
    band passes the outside window unchanged.
    """
    # Sharp edges would ring: the lower one spans 0.3 of `low`, the upper one 0.05 of `high`.
    below, above = 0.3 * low, 0.05 * high
    start, stop = (low - below, high) if outside else (low, high - above)
    rising = np.clip((frequencies - start) / below, 0, 1)
    falling = np.clip((frequencies - stop) / above, 0, 1)
    return np.asarray((0.5 - 0.5 * np.cos(np.pi * rising)) * (0.5 + 0.5 * np.cos(np.pi * falling)))


def resample(signal: FloatArray, samples: int) -> FloatArray:
    """Resample periodic band-limited signals (..., any) to another number of samples over the same period."""
    spectrum = np.fft.rfft(signal)
    lines = samples // 2 + 1
    kept = np.zeros((*signal.shape[:-1], lines), dtype=np.complex128)
    n = min(lines, spectrum.shape[-1])
    kept[..., :n] = spectrum[..., :n]
    return np.asarray(np.fft.irfft(kept, samples) * (samples / signal.shape[-1]))


def third_octave(f: FloatArray) -> IntArray:
    """Number of the third octave that each frequency (Hz) lies in: of 0 the lowest is 1 kHz."""
    return np.asarray(np.floor(3 * np.log2(f / 1000.0)).astype(int))


def third_octaves(
    signal: FloatArray, rate_hz: float, low: float, high: float
) -> tuple[FloatArray, FloatArray]:
    """Third-octave bands centred within `low` to `high`: their centres (Hz), and the levels in them.

    Exact centres to base ten (IEC 61260-1:2014, 5.2 to 5.4): 1000 Hz x 10^(n / 10), edges half a
    band either side. Levels are dB re 1 m/s^2 rms over the record, from the lines of its spectrum.
    """
    numbers = np.arange(-30, 10)
    centres = 1000.0 * 10.0 ** (numbers / 10)
    half = 10.0**0.05
    kept = centres[(centres >= low) & (centres <= high)]
    power = 2 * np.abs(np.fft.rfft(signal) / len(signal)) ** 2
    f = np.fft.rfftfreq(len(signal), 1 / rate_hz)
    levels = [power[(f >= c / half) & (f < c * half)].sum() for c in kept]
    return kept, 10 * np.log10(np.maximum(levels, 1e-30))
