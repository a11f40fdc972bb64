"""The board: the one snapshot of what the worker does, from which every page is drawn.

A snapshot rather than a stream of events, so that a page that was reloaded, a second tab and a server that
was started again all show the same without a history.
"""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from typing import Any

from ...acquisition import PressVerdict


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
