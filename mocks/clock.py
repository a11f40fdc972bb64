"""Virtual time: a wait advances it at once, so nothing in a simulated rig sleeps."""

from __future__ import annotations

import threading
from collections.abc import Callable

from haploop.instruments.clock import Clock

__all__ = ["VirtualClock"]


class VirtualClock(Clock):
    """A clock that jumps to the end of every wait. Safe to share between threads."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start
        self._lock = threading.Lock()

    def now(self) -> float:
        """See `Clock.now`."""
        return self._now

    def sleep(self, duration: float) -> None:
        """See `Clock.sleep`."""
        with self._lock:
            self._now += max(0.0, duration)

    def sleep_until(self, when: float) -> None:
        """Jump to `when` (s), unless another thread's wait has already moved time past it."""
        with self._lock:
            self._now = max(self._now, when)

    def hold(self, until: Callable[[], object]) -> None:
        """See `Clock.hold`."""
        until()
