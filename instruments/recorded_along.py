"""Instruments recorded along with presses but not through the DAQ: a thermometer, a camera.

A role of any package can be recorded along if it implements `RecordedAlong`. A recording reads it in
a thread of its own, so that a slow instrument delays no sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from ..base.clock import Clock


@dataclass(frozen=True)
class Reading:
    """One reading: its name, value and unit."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True)
class NewFile:
    """A file written beside the recording: its name and its path."""

    name: str
    path: Path


@runtime_checkable
class RecordedAlong(Protocol):
    """An instrument that is recorded along. Every method may raise InstrumentError."""

    reads: tuple[str, ...]
    """Names of the readings and files that `read` may return."""
    reads_hz: float
    """Highest rate of reading (Hz): the true interval is never shorter."""

    def start(self, stem: Path, clock: Clock) -> None:
        """Prepare, before the first sample. Names of its files begin with `stem`; it overwrites nothing.

        `stem` is the recording's path without its ending: `data/P01-latch` of `data/P01-latch.h5`.
        """

    def read(self) -> Sequence[Reading | NewFile]:
        """Return what is new: at most one of each name in `reads`. A file is complete and closed."""

    def stop(self) -> Sequence[Reading | NewFile]:
        """Stop, and release what `start` acquired; return what is left, as `read`. May be called again."""
