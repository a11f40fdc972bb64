"""The plant's interface to everything wired to it: nodes that carry a voltage, contacts, laser heads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock

__all__ = ["LaserHead", "Nodes", "Run", "SamplesLost", "Source", "Switched", "Switches"]


@dataclass(frozen=True, eq=False)
class Run:
    """Voltages (V) that an output steps through: value k is held from `start + k * period` (s of
    the plant's clock) until the next value, the last one until the next run.
    """

    start: float
    period: float
    values: FloatArray


class Source(Protocol):
    """An output terminal, as the plant sees it."""

    def take(self, until: float) -> Sequence[Run]:
        """Steps after the previous call's `until` and not after `until` (s), in order of time.

        No steps means that the voltage stays. Called with `until` that never goes back.
        """


class SamplesLost(Exception):  # noqa: N818  what has happened, in whatever words a card's maker has for it
    """A card has lost samples: the host did not take them in time, or the card's own memory overflowed."""

    def __init__(self, device: str, how: Literal["overrun", "overflow"]) -> None:
        super().__init__(f"Samples of {device} were lost.")
        self.device = device
        self.how = how


class Nodes(Protocol):
    """The plant as a set of voltage nodes. Every method is safe to call from any thread."""

    clock: Clock

    def read(self, node: str, times: FloatArray) -> FloatArray:
        """Voltage at a node that is measured ((times,) V), before any converter, at rising times (s).

        Times may lie up to 30 s before the latest time asked for on any node, and not after
        `clock.now()`. Raises SamplesLost when a fault says so.
        """

    def drive(self, node: str, source: Source) -> None:
        """Let `source` drive a node from now on (the plant takes its steps as time goes on)."""


Switched = tuple[str, bool, float]
"""A patch, whether its contact closed, and when (s)."""


class Switches(Protocol):
    """A box of relays, as the plant sees it."""

    def take(self, until: float) -> Sequence[Switched]:
        """Every contact that switches because of what happened by `until` (s), once."""


@dataclass
class LaserHead:
    """The optics and the decoder of a vibrometer as they really are, whatever a rig file says."""

    range: float
    """Full scale (m/s): the output clips there."""
    scale: float
    """m/s per V at the output."""
    bandwidth_hz: float
    delay: float
    """Seconds by which the output is late."""
    level: float = 1.0
    """Share of the light that comes back, 0 to 1; without light there is only noise."""
