"""The board: the one snapshot of what the worker does, from which every page is drawn.

A snapshot rather than a stream of events, so that a page that was reloaded, a second tab and a server that
was started again all show the same without a history. For the same reason the worker itself looks at the
stream: which run goes on, and what was at the end of its range. Overloads are latched here, and not in the
page's server, so that one that came while no server ran is shown too.
"""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from typing import Any, Self

import numpy as np

from ...acquisition import PressVerdict
from ...instruments import LiveBlock, Rig


class Board:
    """Named values of JSON's types with a version that grows with every change. For any thread."""

    def __init__(self, **values: Any) -> None:
        self._values = values
        self._version = 1
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)

    def __getitem__(self, name: str) -> Any:
        """Return a value; not to be changed in place."""
        with self._lock:
            return self._values[name]

    def set(self, **values: Any) -> None:
        """Replace values."""
        with self._lock:
            self._values |= values
            self._version += 1
            self._changed.notify_all()

    def change(self, name: str, by: Callable[[Any], Any]) -> None:
        """Replace a value by a function of it, in one step."""
        with self._lock:
            self._values[name] = by(self._values[name])
            self._version += 1
            self._changed.notify_all()

    def snapshot(self, after: int = 0, timeout: float = 0.0) -> str:
        """Return values and `version` as JSON, once the version is above `after`, or after `timeout` s."""
        with self._lock:
            self._changed.wait_for(lambda: self._version > after, timeout)
            return json.dumps({**self._values, "version": self._version})

    def progress(self, doing: str, done: float, total: float, unit: str) -> None:
        """Show how far a job is: `done` of `total`, in a unit."""
        self.set(progress={"doing": doing, "done": float(done), "total": float(total), "unit": unit})

    def verdict(self, participant: str, button: str, press: PressVerdict) -> None:
        """Show the verdict on a press; step by step, the session pauses behind it."""
        shown = {
            "number": press.number,
            "attempt": press.attempt,
            "accepted": bool(press.accepted),
            "force": None if math.isnan(press.force) else float(press.force),
            "flags": list(press.flags),
            "reason": press.reason,
        }

        def add(session: dict[str, Any]) -> dict[str, Any]:
            known = session["verdicts"]
            if (session["participant"], session["button"]) != (participant, button):
                known = []
            others = [v for v in known if (v["number"], v["attempt"]) != (press.number, press.attempt)]
            return {**session, "participant": participant, "button": button, "verdicts": [*others, shown]}

        self.change("session", add)
        if self["step"]:
            self.set(paused=True)


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
