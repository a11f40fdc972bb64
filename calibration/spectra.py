"""Signals within a band: what drive and check do alike, so that they compare like with like."""

from __future__ import annotations

import numpy as np
from scipy.fft import irfft, rfft, rfftfreq

from haploop.instruments.arrays import FloatArray

__all__ = ["band_window", "fade", "resample", "third_octaves"]


def fade(samples: int, rise: int, fall: int) -> FloatArray:
    """(samples,): zero to one over the first `rise` samples, one to zero over the last `fall`."""
    window = np.ones(samples)
    window[:rise] = 0.5 - 0.5 * np.cos(np.pi * np.arange(rise) / max(rise, 1))
    window[samples - fall :] = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, fall + 1) / max(fall, 1))
    return window


def band_window(frequencies: FloatArray, low: float, high: float, outside: bool = False) -> FloatArray:
    """Weights of `frequencies` (Hz): one within the band and zero beyond, with cosine edges.

    The edges lie inside `low` to `high`, or with `outside` just beyond, so that a signal that was
    cut to the band passes the outside window unchanged.
    """
    # No brick wall: a third of an octave below, a twelfth above.
    below, above = 0.3 * low, 0.05 * high
    start, stop = (low - below, high) if outside else (low, high - above)
    rising = np.clip((frequencies - start) / below, 0, 1)
    falling = np.clip((frequencies - stop) / above, 0, 1)
    return np.asarray((0.5 - 0.5 * np.cos(np.pi * rising)) * (0.5 + 0.5 * np.cos(np.pi * falling)))


def resample(signal: FloatArray, samples: int) -> FloatArray:
    """A periodic band-limited signal on another number of samples over the same time."""
    spectrum = rfft(signal)
    lines = samples // 2 + 1
    kept = np.zeros(lines, dtype=np.complex128)
    n = min(lines, len(spectrum))
    kept[:n] = spectrum[:n]
    return np.asarray(irfft(kept, samples) * (samples / len(signal)))


def third_octaves(
    signal: FloatArray, rate_hz: float, low: float, high: float
) -> tuple[FloatArray, FloatArray]:
    """Centres (Hz) of the third-octave bands centred within `low` to `high`, and the levels in them.

    Exact centres to base ten (IEC 61260-1:2014, 5.2 to 5.4): 1000 Hz x 10^(n / 10), edges half a
    band either side. Levels are dB re 1 m/s^2 rms over the record, from its spectrum's own lines.
    """
    numbers = np.arange(-30, 10)
    centres = 1000.0 * 10.0 ** (numbers / 10)
    half = 10.0**0.05
    kept = centres[(centres >= low) & (centres <= high)]
    power = 2 * np.abs(rfft(signal) / len(signal)) ** 2
    f = rfftfreq(len(signal), 1 / rate_hz)
    levels = [power[(f >= c / half) & (f < c * half)].sum() for c in kept]
    return kept, 10 * np.log10(np.maximum(levels, 1e-30))
