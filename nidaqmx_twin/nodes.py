"""Voltage nodes: what simulated cards and generators share with the world that they are wired to.

The plant is such a world, and the signals that a test sets are another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from ..base.arrays import FloatArray
from ..base.clock import Clock

Signal = Callable[[FloatArray], FloatArray]
"""Function that returns the volts of an instrument's output, (times,) V before any converter, at rising
times, (times,) s of the plant's clock. It may be asked for the same times again, and for 30 s before them."""


@dataclass(frozen=True, eq=False)
class Run:
    """Staircase of an output: value k (V) is held from `start + k * period` (s of the plant's clock)
    until the next value, the last one until the next run.

    One value that is held, rather than played at a rate, has a period of infinity.
    """

    start: float
    period: float
    values: FloatArray
    node: str = ""
    """The amplifier's input that it drives, where it comes from the plant."""

    @property
    def times(self) -> FloatArray:
        """The time of each value, (steps,) s."""
        times = np.full(len(self.values), self.start)
        times[1:] += self.period * np.arange(1, len(times))  # the first of a held value is not inf x 0
        return times


class Source(Protocol):
    """An output terminal, as the plant sees it."""

    def take(self, until: float) -> Sequence[Run]:
        """Return the steps after the previous call's `until` and up to `until` (s), in order of time.

        No steps means that the voltage stays. `until` never decreases from call to call.
        """


class Called(Protocol):
    """A card whose program fills its outputs in callbacks, as the plant sees it."""

    def call(self, until: float) -> None:
        """Call back for each period that has ended by `until` (s): what comes out by then is known."""


class SamplesLost(Exception):  # noqa: N818  an event, which each maker's driver reports in its own words
    """Lost samples of a card: the host did not take them in time, or the card's own memory overflowed."""

    def __init__(self, device: str, how: Literal["overrun", "overflow"]) -> None:
        super().__init__(f"Samples of {device} were lost.")
        self.how = how


class PlayStopped(Exception):  # noqa: N818  an event, as SamplesLost
    """A play that ended before its time: a buffer or the card's memory was empty, or somebody stopped it."""

    def __init__(self, device: str, how: Literal["underflow", "fifo", "stopped"]) -> None:
        super().__init__(f"{device} stopped playing.")
        self.how = how


class Nodes(Protocol):
    """The plant as a set of voltage nodes. Every method is safe to call from any thread."""

    clock: Clock

    def read(self, nodes: Sequence[str], times: FloatArray) -> FloatArray:
        """Return the voltages at measured nodes, (nodes, times) V, before any converter.

        `times` are (nodes, times) s, rising for each node. They may lie up to 30 s before the latest time
        read on any node, and not after `clock.now()`. Raises SamplesLost when a fault makes a card lose
        samples.
        """

    def plays(self, device: str) -> None:
        """Called when a card is asked how far its play is. Raises PlayStopped when a fault has ended it."""

    def drive(self, node: str, source: Source) -> None:
        """Connect `source` to a node from now on; the plant takes its steps as time advances.

        Outputs of several instruments at one node add up.
        """
