"""Mains hum in a signal: narrow lines at 50 or 60 Hz and their multiples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray

_MAINS = (50.0, 60.0)
_HIGHEST = 650.0
"""Highest harmonic that is looked for (Hz)."""
_CLEAR = 15.0
"""Power of a line over that of its surroundings, at which it is a line: in 4000 signals of noise none was."""
_LINE, _NEAR, _FAR = 2, 4, 12
"""Half-width of a line, and its surroundings, in lines of the spectrum."""
_SHORTEST = 0.4
"""Shortest signal (s) in which 50 and 60 Hz and their surroundings are told apart."""


@dataclass(frozen=True)
class Hum:
    """`mains_hz` is 50 or 60; `rms` that of all its lines, in the signal's unit; `share` of its power."""

    mains_hz: float
    rms: float
    share: float


def mains_hum(signal: FloatArray, rate_hz: float) -> Hum | None:
    """Find mains hum in a signal (samples,); None when there is none, or in less than 0.4 s.

    A slow drift does not count as power. A line stands out of its surroundings by a factor of 15 in power;
    one at the fundamental or its double is required, because 300 Hz is a multiple of both.
    """
    n = len(signal)
    if n < _SHORTEST * rate_hz:
        return None
    t = np.arange(n)
    still = signal - np.polyval(np.polyfit(t, signal, 2), t)
    window = np.hanning(n + 1)[:-1]
    power = 2 * np.abs(np.fft.rfft(still * window)) ** 2 / (n * (window**2).sum())
    f = np.asarray(np.fft.rfftfreq(n, 1 / rate_hz), dtype=np.float64)
    found = [hum for mains_hz in _MAINS if (hum := _lines(power, f, mains_hz))]
    return max(found, key=lambda hum: hum.rms) if found else None


def _lines(power: FloatArray, f: FloatArray, mains_hz: float) -> Hum | None:
    total, clear = 0.0, []
    for number in range(1, int(_HIGHEST / mains_hz) + 1):
        k = round(number * mains_hz / f[1])
        if k + _FAR >= len(power):
            break
        line = power[max(k - _LINE, 1) : k + _LINE + 1]
        below, above = power[max(k - _FAR, 1) : max(k - _NEAR, 1)], power[k + _NEAR : k + _FAR + 1]
        if line.mean() > _CLEAR * np.concatenate([below, above]).mean():
            clear.append(number)
            total += float(line.sum())
    if not {1, 2} & set(clear):
        return None
    return Hum(mains_hz, float(np.sqrt(total)), total / float(power.sum()))
