"""Actuators between the relay's contacts and the surface: the law of each, and the voltage across it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from .hysteresis import PatchLaw
from .poles import Course, Poles
from .surface import AMPLIFIER_POLE_HZ, REMEMBERED


class Patches:
    """The actuators of all patches of a surface, at rest at zero volts."""

    def __init__(self, laws: Mapping[str, PatchLaw], amplifier_pole_hz: float = AMPLIFIER_POLE_HZ) -> None:
        self._laws = dict(laws)
        pole = 2 * np.pi * amplifier_pole_hz
        count = len(self._laws)
        self._poles = Poles(np.full(count, -pole, dtype=np.complex128), np.eye(count))
        self._weights = dict(zip(self._laws, pole * np.eye(count, dtype=np.complex128), strict=True))
        self._course: Course[Mapping[str, ComplexArray]] = Course(self._weights, self._poles, REMEMBERED)
        self._driven: set[str] = set()
        """Patches that have carried another voltage than zero."""

    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Apply the amplifier's output at each patch, (steps,) V, as `Surface.step`; return linear volts."""
        levels = np.array([volts[patch] for patch in self._laws])
        self._driven.update(patch for patch, own in zip(self._laws, levels, strict=True) if own.any())
        self._course.step(self._weights, self._poles, start, period, levels)
        return {patch: law.follow(volts[patch]) for patch, law in self._laws.items()}

    def voltage(self, patch: str, times: FloatArray) -> FloatArray:
        """Return the voltage across a patch, (times,) V, at rising times (s)."""
        if patch not in self._driven:
            return np.zeros(len(times))
        return self._course.seen(times, lambda weights: weights[patch])
