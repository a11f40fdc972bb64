"""A flag between threads that no interrupt can tear.

`threading.Event` takes its lock in steps of Python. A Ctrl-C between two of them leaves the lock taken, and
whoever sets, clears or waits next hangs: the way out, too. Here each step on the lock is one call into C,
which an interrupt comes before or after. (So is `with lock`, but not `with condition`: enter a condition by
its lock.)
"""

from __future__ import annotations

import threading
from contextlib import suppress

_SLICE = 0.1
"""Longest single wait (s): on Windows, Ctrl-C interrupts none. A wait that is interrupted just after it ended
costs others no more than this."""


class Flag:
    """Up or down, and waited for until it is up. What is up for a moment only can be missed."""

    def __init__(self) -> None:
        self._up = False
        # Taken while the flag is down.
        self._gate = threading.Lock()
        self._gate.acquire()

    def is_set(self) -> bool:
        """Return True while the flag is up."""
        return self._up

    def set(self) -> None:
        """Put the flag up. Never waits."""
        self._up = True
        self._open()

    def clear(self) -> None:
        """Take the flag down. Never waits."""
        self._up = False
        self._gate.acquire(blocking=False)

    def wait(self, duration: float) -> bool:
        """Wait until the flag is up, at most `duration` s of real time; return True when it is."""
        while not self.is_set() and duration > 0:
            if self._gate.acquire(timeout=min(duration, _SLICE)) and self.is_set():
                self._open()  # for the next who waits
            duration -= _SLICE
        return self.is_set()

    def _open(self) -> None:
        with suppress(RuntimeError):  # it is open
            self._gate.release()
