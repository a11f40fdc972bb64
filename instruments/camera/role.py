"""The camera role: grey frames of the touch surface, numbered, with their times."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Frame:
    """One image."""

    pixels: Pixels
    """(rows, columns), 0 dark to 255 saturated."""
    number: int
    """Counts what the camera has taken, from 0: a number that is missing is a frame that was lost."""
    time: float
    """Best estimate of the middle of the exposure (s of the rig's clock)."""


class Camera(ABC):
    """Takes frames at a constant rate.

    Has no output, so that its safe state is whatever it does. `read` has a deadline, and a frame that was
    lost shows as a gap in the frames' numbers: never is an old frame given twice, or a gap hidden.
    """

    identity: str
    shape: tuple[int, int]
    """(rows, columns) of each frame."""
    rate_hz: float
    """Nominal rate of frames."""

    @abstractmethod
    def start(self) -> None:
        """Begin to take frames; those from before are dropped. Raises InstrumentError."""

    @abstractmethod
    def read(self) -> Frame:
        """Return the oldest frame that was not read yet; wait for it, a second at most.

        Raises InstrumentError when none comes, or the camera was not started.
        """

    @abstractmethod
    def stop(self) -> None:
        """Take no more frames. May be called again."""

    @abstractmethod
    def close(self) -> None:
        """Stop, and close the device. May be called again."""
