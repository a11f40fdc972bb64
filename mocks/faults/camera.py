"""Faults of the camera under the surface, and of what it sees."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from ...instruments.bounded import Positive
from ..plant import Fault, FaultSettings, PerEventFault, TimedFault

__all__ = ["AmbientLight", "Defocus", "FramesLost", "SecondFinger"]


class AmbientLight(TimedFault):
    """Daylight or a lamp adds to what the camera sees."""

    class Settings(TimedFault.Settings):
        """See `FaultSettings`."""

        duration: Annotated[float, Field(gt=0)] = 1e9
        light: Positive = 60.0
        """Grey levels at the image's centre."""

    settings: Settings

    def lamp(self, level: float, time: float) -> float:
        """See `Fault.lamp`."""
        return level + self.settings.light * bool(self.active(np.array([time]))[0])


class Defocus(Fault):
    """The camera is out of focus."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        blur: Positive = 12.0
        """Standard deviation (pixels)."""

    settings: Settings

    def blur(self, pixels: float, time: float) -> float:
        """See `Fault.blur`."""
        self.mark(time)
        return max(pixels, self.settings.blur)


class SecondFinger(TimedFault):
    """Another finger, or the ball of the thumb, touches the surface."""

    class Settings(TimedFault.Settings):
        """See `FaultSettings`."""

        duration: Annotated[float, Field(gt=0)] = 1e9
        area: Positive = 60e-6
        """m^2."""

    settings: Settings

    def other_finger(self, time: float) -> float:
        """See `Fault.other_finger`."""
        return self.settings.area * bool(self.active(np.array([time]))[0])


class FramesLost(PerEventFault):
    """Frames are lost between camera and program."""

    def frame_lost(self, time: float) -> bool:
        """See `Fault.frame_lost`."""
        return self.fires(time)
