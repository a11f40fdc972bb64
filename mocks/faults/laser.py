"""Faults of the vibrometer, of the laser's light path, and of the camera under the surface."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from ...base.arrays import FloatArray
from ...base.bounded import Positive
from ...instruments.config import RigFile
from ..plant import FaultSettings, LaserHead, OnCamera, OnLaser, PerEventFault, ScheduledFault, TimedFault


class VibrometerRange(OnLaser):
    """The vibrometer's range differs from the rig file's."""

    class Settings(FaultSettings):
        range: Positive = 0.1
        """Actual full scale (m/s)."""

    settings: Settings

    def head(self, head: LaserHead) -> None:
        head.scale *= self.settings.range / head.range
        head.range = self.settings.range

    def inspected(self, now: float) -> None:
        self.mark(now)


class LaserAskew(OnLaser):
    """The laser does not look along the motion, or its scale is wrong: it shows a share of the velocity."""

    class Settings(FaultSettings):
        scale: Positive = 0.85
        """Shown velocity over the surface's own: the cosine of the angle, or the error of the scale."""

    settings: Settings

    def velocity(
        self, velocity: FloatArray, times: FloatArray, full_scale: float, rng: np.random.Generator
    ) -> FloatArray:
        if velocity.any():
            self.mark(float(times[0]))
        return self.settings.scale * velocity


class LaserDropout(TimedFault, OnLaser):
    """Too little light returns for a short time, and the output jumps between both ends of its range."""

    class Settings(TimedFault.Settings):
        duration: Positive = 5e-3

    def velocity(
        self, velocity: FloatArray, times: FloatArray, full_scale: float, rng: np.random.Generator
    ) -> FloatArray:
        lost = self.active(times)
        velocity[lost] = 1.2 * full_scale * rng.choice([-1.0, 1.0], int(lost.sum()))
        return velocity


class LaserSpikes(ScheduledFault, OnLaser):
    """Speckle makes the output spike for a moment, at random times, mostly far below the end of its range."""

    class Settings(ScheduledFault.Settings):
        rate: Positive = 2.0
        """Mean number per second."""
        height: Positive = 2e-3
        """Mean height (m/s); heights are exponentially distributed, with either sign."""
        width: Annotated[float, Field(strict=True, gt=0, le=0.1)] = 1e-4
        """Duration of each (s)."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._drawn = int(rng.integers(2**63))

    def velocity(
        self, velocity: FloatArray, times: FloatArray, full_scale: float, rng: np.random.Generator
    ) -> FloatArray:
        # Each second has its own spikes, so that they do not depend on the blocks in which it is read.
        for second in range(int(times[0] - self.settings.width), int(times[-1]) + 1):
            for at, height in self._of(second):
                first, last = np.searchsorted(times, [at, at + self.settings.width])
                if at < self.begin or first == last:
                    continue
                velocity[first:last] += height
                if at not in self.at:
                    self.at.append(at)
        return np.clip(velocity, -full_scale, full_scale)

    def _of(self, second: int) -> list[tuple[float, float]]:
        """Return time (s) and height (m/s) of the spikes that begin within a second."""
        rng = np.random.default_rng([self._drawn, second])
        count = rng.poisson(self.settings.rate)
        heights = self.settings.height * rng.exponential(size=count) * rng.choice([-1.0, 1.0], count)
        return list(zip((second + rng.uniform(size=count)).tolist(), heights.tolist(), strict=True))


class LaserBlocked(TimedFault, OnLaser):
    """The laser beam is blocked: the velocity is lost, and the noise is ten times as large."""

    def light(self, level: FloatArray, times: FloatArray) -> FloatArray:
        level[self.active(times)] = 0.0
        return level


# Faults of the camera under the surface, and of what it sees.


class AmbientLight(TimedFault, OnCamera):
    """Daylight or a lamp adds to what the camera sees."""

    class Settings(TimedFault.Settings):
        duration: Positive = 1e9
        light: Positive = 60.0
        """Grey levels at the image's centre."""

    settings: Settings

    def lamp(self, level: float, time: float) -> float:
        return level + self.settings.light * bool(self.active(np.array([time]))[0])


class Defocus(OnCamera):
    """The camera is out of focus."""

    class Settings(FaultSettings):
        blur: Positive = 12.0
        """Standard deviation (pixels)."""

    settings: Settings

    def blur(self, pixels: float, time: float) -> float:
        self.mark(time)
        return max(pixels, self.settings.blur)


class SecondFinger(TimedFault, OnCamera):
    """Another finger, or the ball of the thumb, touches the surface."""

    class Settings(TimedFault.Settings):
        duration: Positive = 1e9
        area: Positive = 60e-6
        """m^2."""

    settings: Settings

    def other_finger(self, time: float) -> float:
        return self.settings.area * bool(self.active(np.array([time]))[0])


class FramesLost(PerEventFault, OnCamera):
    """Frames are lost between camera and program."""

    def frame_lost(self, time: float) -> bool:
        return self.fires(time)
