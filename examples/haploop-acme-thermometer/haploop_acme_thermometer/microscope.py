"""The role microscope, and the ACME C1: a stub driver that records frames as files along with presses."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict

from haploop.base.clock import Clock
from haploop.base.errors import InstrumentError
from haploop.instruments import NewFile


class Microscope(ABC):
    """A source of frames, recorded along with presses: `P01-latch-frame0001.pgm` beside `P01-latch.h5`."""

    identity: str
    reads: tuple[str, ...] = ("frame",)
    reads_hz: float = 2.0
    _stem = Path()
    _taken = 0

    @abstractmethod
    def grab(self) -> bytes:
        """Return the newest frame as a PGM file. Raises InstrumentError."""

    @abstractmethod
    def close(self) -> None:
        """Close the microscope. May be called again."""

    def start(self, stem: Path, clock: Clock) -> None:
        self._stem = stem
        # Continue after the frames of an earlier session that ended before its first press.
        self._taken = len(list(stem.parent.glob(f"{stem.name}-frame*.pgm")))

    def read(self) -> Sequence[NewFile]:
        frame = self.grab()
        path = self._stem.with_name(f"{self._stem.name}-frame{self._taken + 1:04d}.pgm")
        with path.open("xb") as file:  # x: a frame never overwrites another
            file.write(frame)
        self._taken += 1
        return [NewFile("frame", path)]

    def stop(self) -> Sequence[NewFile]:
        """Do nothing: every frame's file is complete."""
        return ()


class AcmeC1(Microscope):
    class Settings(BaseModel):
        model_config = ConfigDict(frozen=True, extra="forbid")

    def __init__(self, grab: Callable[[], bytes]) -> None:
        self._grab = grab
        self.identity = "ACME C1"

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        raise InstrumentError(
            "The ACME C1 does not exist: use --simulate, or write a driver for your microscope."
        )

    def grab(self) -> bytes:
        return self._grab()

    def close(self) -> None:
        """Do nothing: nothing is open."""
