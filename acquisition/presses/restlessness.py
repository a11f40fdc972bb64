"""The cause of a force that is not at rest, where it is not a hand: mains hum, or creep."""

from __future__ import annotations

import numpy as np

from ...base.arrays import FloatArray
from ...instruments.mains import mains_hum

_HUM_SHARE = 0.5
"""Smallest share of a restless force's power in mains hum at which that is the cause."""
_STEADY = 0.9
"""Smallest share of the variation that a straight line explains in a sensor that drifts."""
_BLOCK = 0.025
"""Averaging time (s) that suppresses noise."""
_CREPT = 0.15
"""Largest force after a press, over its peak, that counts as creep: a sensor creeps by some percent."""
_NOISE = 0.02
"""N by which the mean of a block may rise by noise."""


def restlessness(force: FloatArray, rate_hz: float) -> str:
    """Cause of a restless force (samples,) N and its remedy, as a clause; empty when it may be a hand."""
    hum = hum_of(force, rate_hz)
    if hum:
        return hum
    means = _means(force, rate_hz)
    t = np.arange(len(means)) * _BLOCK
    if len(means) < 5 or not np.ptp(means):
        return ""
    slope, start = np.polyfit(t, means, 1)
    steady = 1 - np.var(means - start - slope * t) / np.var(means)
    if steady < _STEADY:
        return ""
    return (
        f"it drifts by {slope:+.2g} N/s, steadily, as a sensor does that warms up or creeps after a load; "
        "wait until it has settled"
    )


def hum_of(force: FloatArray, rate_hz: float) -> str:
    """A clause on mains hum that makes most of a force's (samples,) variation; empty without."""
    hum = mains_hum(force, rate_hz)
    if hum is None or hum.share < _HUM_SHARE:
        return ""
    return (
        f"the force sensor has mains hum, {hum.rms:.2g} N rms at {hum.mains_hz:g} Hz; check the grounding "
        "and the shield of its cable"
    )


def crept(force: FloatArray, peak: float, rate_hz: float) -> bool:
    """True when a force (samples,) N after a press of `peak` N fades as a sensor creeps.

    Creep is small, only falls, and falls ever more slowly; a finger that rests on the button takes its force
    away at the end.
    """
    means = _means(force, rate_hz)
    if len(means) < 4 or means.max() > _CREPT * peak:
        return False
    half = len(means) // 2
    early, late = means[0] - means[half], means[half] - means[-1]
    return bool((np.diff(means) < _NOISE).all() and early > late)


def _means(force: FloatArray, rate_hz: float) -> FloatArray:
    block = max(1, round(_BLOCK * rate_hz))
    count = len(force) // block
    return np.asarray(force[: count * block].reshape(count, block).mean(axis=1))
