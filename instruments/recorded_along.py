"""What is recorded along with presses and is on no DAQ: a thermometer's readings, a camera's frames.

A role of any package becomes one by having what `RecordedAlong` names. A recording asks it for
readings in a thread of its own, so that however slow it is, no sample waits for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from haploop.instruments.clock import Clock

__all__ = ["NewFile", "Reading", "RecordedAlong"]


@dataclass(frozen=True)
class Reading:
    """A number that was read: what it is, its value, and its unit."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True)
class NewFile:
    """A file that was written beside the recording: what it is, and where."""

    name: str
    path: Path


@runtime_checkable
class RecordedAlong(Protocol):
    """An instrument that is recorded along. Every method may raise InstrumentError."""

    reads: tuple[str, ...]
    """Names of what `read` may give."""
    reads_hz: float
    """How often it is read, at most: the true interval is never shorter."""

    def start(self, stem: Path, clock: Clock) -> None:
        """Get ready, before the first sample. Files that are written begin with `stem` and overwrite nothing.

        `stem` is the recording's path without its ending: `data/P01-latch` of `data/P01-latch.h5`.
        """

    def read(self) -> Sequence[Reading | NewFile]:
        """What is new: at most one of each name in `reads`, or nothing. A file is whole and closed."""

    def stop(self) -> None:
        """End what `start` began. May be called again."""
