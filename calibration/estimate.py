"""What an estimator of responses hands back, whatever was played."""

from __future__ import annotations

from dataclasses import dataclass

from instruments.arrays import ComplexArray, FloatArray

__all__ = ["Estimate"]


@dataclass(frozen=True, eq=False)
class Estimate:
    """Fields as in `Response`, which says what they are; arrays are (lines,)."""

    frequencies: FloatArray
    velocity: ComplexArray
    deviation: FloatArray
    coherence: FloatArray
    path: ComplexArray
    noise: FloatArray
    distortion: FloatArray
    level_gain: ComplexArray
