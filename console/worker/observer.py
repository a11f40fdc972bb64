"""The worker's own look at the stream: which run goes on, and what was at the end of its range.

Overloads are latched here, and not in the page's server, so that one that came while no server ran is
shown too.
"""

from __future__ import annotations

import threading
from typing import Any, Self

import numpy as np

from ...instruments import LiveBlock, Rig
from .board import Board

_WAIT = 0.25
_CAPACITY = 400
"""Blocks: 16 s of a recording, in which this thread need not run."""


class Observer:
    """Follows a rig's tap in a thread while its context lasts."""

    def __init__(self, rig: Rig, board: Board) -> None:
        self._tap = rig.tap(_CAPACITY)
        self._board = board
        self._run = 0
        self._thread = threading.Thread(target=self._follow, name="haploop-observer", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._tap.close()

    def _follow(self) -> None:
        while not self._tap.closed:
            block = self._tap.take(_WAIT)
            if block is not None:
                self._look(block)

    def _look(self, block: LiveBlock) -> None:
        run = block.run
        if run.number != self._run:
            self._run = run.number
            shown = {"number": run.number, "doing": run.doing, "about": run.about, "rate_hz": run.rate_hz}
            self._board.set(run={**shown, "channels": list(run.channels)})
        # A contact has two states and no range.
        contact = run.sensors.activation.channels if run.sensors.activation else ()
        each = zip(run.channels, block.overload, strict=True)
        beyond = [name for name, over in each if over and name not in contact]
        for name, sensor in run.sensors.linear.items():
            # What has a rest of its own is not at its end by the weight on it.
            if not sensor.tared and set(sensor.channels) <= set(run.channels):
                rows = [run.channels.index(channel) for channel in sensor.channels]
                if np.any(sensor.saturated(block.volts[rows])):
                    beyond.append(name)
        if beyond:
            at = block.first / run.rate_hz
            self._board.change("saturated", lambda old: _latched(old, beyond, at))


def _latched(old: dict[str, Any], names: list[str], at: float) -> dict[str, Any]:
    """Add overloads at `at` (s); the first time and the number of blocks of each are kept."""
    found = dict(old)
    for name in names:
        before = found.get(name, {"first": at, "blocks": 0})
        found[name] = {**before, "blocks": before["blocks"] + 1}
    return found
