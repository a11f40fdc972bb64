"""Faults of the camera under the surface, and of what it sees."""

from __future__ import annotations

import numpy as np

from ...base.bounded import Positive
from ..plant import FaultSettings, OnCamera, PerEventFault, TimedFault


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
