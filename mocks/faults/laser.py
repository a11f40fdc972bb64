"""Faults of the vibrometer and of the laser's light path."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from haploop.instruments.arrays import FloatArray
from haploop.mocks.plant import Fault, FaultSettings, LaserHead, Positive, TimedFault

__all__ = ["LaserBlocked", "LaserDropout", "VibrometerRange"]


class VibrometerRange(Fault):
    """The vibrometer's range differs from the rig file's."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        range: Positive = 0.1
        """Actual full scale (m/s)."""

    settings: Settings

    def head(self, head: LaserHead) -> None:
        """See `Fault.head`."""
        head.scale *= self.settings.range / head.range
        head.range = self.settings.range

    def inspected(self, now: float) -> None:
        """See `Fault.inspected`."""
        self.mark(now)


class LaserDropout(TimedFault):
    """Too little light returns for a short time, and the output jumps between both ends of its range."""

    class Settings(TimedFault.Settings):
        """See `FaultSettings`."""

        duration: Annotated[float, Field(gt=0)] = 5e-3

    def velocity(
        self, velocity: FloatArray, times: FloatArray, full_scale: float, rng: np.random.Generator
    ) -> FloatArray:
        """See `Fault.velocity`."""
        lost = self.active(times)
        velocity[lost] = 1.2 * full_scale * rng.choice([-1.0, 1.0], int(lost.sum()))
        return velocity


class LaserBlocked(TimedFault):
    """The laser beam is blocked: the velocity is lost, and the noise is ten times as large."""

    def light(self, level: FloatArray, times: FloatArray) -> FloatArray:
        """See `Fault.light`."""
        level[self.active(times)] = 0.0
        return level
