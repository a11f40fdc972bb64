"""The plant's interface to everything wired to it: nodes that carry a voltage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock

__all__ = ["Nodes", "Run", "Source"]


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


class Nodes(Protocol):
    """The plant as a set of voltage nodes. Every method is safe to call from any thread."""

    clock: Clock

    def read(self, node: str, times: FloatArray) -> FloatArray:
        """Voltage at a node that is measured ((times,) V), before any converter, at rising times (s).

        Times may lie up to 30 s before the latest time asked for on any node, and not after
        `clock.now()`.
        """

    def drive(self, node: str, source: Source) -> None:
        """Let `source` drive a node from now on (the plant takes its steps as time goes on)."""
