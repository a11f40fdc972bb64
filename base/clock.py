"""Injected clocks, so that a simulated rig runs as fast as the CPU."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from .threads import Flag


class Clock(ABC):
    """Monotonic time. Nothing else in the product calls the time module."""

    real = False
    """True when time passes by itself: what is to happen meanwhile needs a thread."""

    @abstractmethod
    def now(self) -> float:
        """Seconds since an arbitrary origin; never goes back."""

    @abstractmethod
    def sleep(self, duration: float) -> None:
        """Return when `duration` seconds have passed on this clock; at once when it is not positive."""

    def wait(self, event: Flag, duration: float) -> bool:
        """Wait for an event, at most `duration` seconds; return True when it is set."""
        return event.wait(duration)

    @abstractmethod
    def hold(self, until: Callable[[], object]) -> None:
        """Stop a virtual clock until `until()` returns.

        A reader thread calls this after each block, with a function that waits for the block's
        consumer. On a virtual clock the consumer (a simulated person, say) then reacts to this
        block and not to a later one. Real time cannot be stopped: a real clock returns at once and
        does not call `until`, so that a reader never waits.
        """


class RealClock(Clock):
    """The machine's monotonic clock."""

    real = True

    def now(self) -> float:
        """See `Clock.now`."""
        return time.monotonic()

    def sleep(self, duration: float) -> None:
        """See `Clock.sleep`."""
        if duration > 0:
            time.sleep(duration)

    def hold(self, until: Callable[[], object]) -> None:
        """Return at once (see `Clock.hold`)."""


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
