"""Result of a frequency response estimator, for any excitation."""

from __future__ import annotations

from dataclasses import dataclass

from ...base.arrays import ComplexArray, FloatArray


@dataclass(frozen=True, eq=False)
class FrfEstimate:
    """Fields as in `Response`; arrays are (lines,)."""

    frequencies: FloatArray
    velocity: ComplexArray
    deviation: FloatArray
    scatter: FloatArray
    coherence: FloatArray
    path: ComplexArray
    noise: FloatArray
    distortion: FloatArray
    level_gain: ComplexArray
