"""Proof of the amplifier's gain before the first play of a session, at a volt and by the drive monitor.

A gain in the rig file that is a tenth of the true one would put ten times the drive on the patch until the
abort monitor stops the play, two blocks later. One volt shows it first. A gain and a divider that are wrong
by the same factor agree, and prove nothing: a gain that is not the product's own asks for its source.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..limits import Limits

__all__ = ["TOO_MUCH", "level_of", "loudest", "tone"]

_LEVEL = 1.0
"""Amplitude (V at the patch)."""
TOO_MUCH = 1.25
"""Volts measured per volt asked for at which the gain is not what the rig file says. Amplifiers of one type
differ by 1 % (docs/hardware.md, "Amplifier"); noise of 0.53 V rms on the monitor would make up the rest."""
_HZ, _SECONDS, _RAMP = 200.0, 0.06, 0.01
_WINDOW = 0.02
"""Length over which the amplitude is measured (s), whole periods of the tone."""


def level_of(limits: Limits) -> float:
    """Amplitude of the proof (V at the patch)."""
    return min(_LEVEL, limits.peak / 4)


def tone(level: float, rate_hz: float) -> FloatArray:
    """The drive of the proof: (samples,) V at the patch."""
    t = np.arange(round(_SECONDS * rate_hz)) / rate_hz
    ramp = np.clip(np.minimum(t, t[-1] - t) / _RAMP, 0.0, 1.0)
    return np.asarray(level * ramp * np.sin(2 * np.pi * _HZ * t))


def loudest(volts: FloatArray, rate_hz: float) -> float:
    """Amplitude of a sine of the power in the loudest window of (samples,) V, whenever it was played."""
    count = min(round(_WINDOW * rate_hz), len(volts))
    power = np.cumsum(np.concatenate([[0.0], (volts - np.median(volts)) ** 2]))
    return float(np.sqrt(2 * (power[count:] - power[:-count]).max() / count))
