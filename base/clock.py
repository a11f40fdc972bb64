"""Injected clocks, so that a simulated rig runs as fast as the CPU, or as a person who watches needs it."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from .threads import Flag

_BEHIND = 0.1
"""Lag behind real time (s) beyond which a `RealTimeClock` does not catch up."""


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


class RealTimeClock(VirtualClock):
    """A virtual clock that never runs ahead of real time, for a simulated rig with a person in front of it.

    It still stops in `hold`, so the same presses give the same recording on a machine of any speed. Time in
    which nothing waits (a person thinks, the machine is slow) is left out rather than caught up.
    """

    def __init__(self) -> None:
        super().__init__()
        self._real = RealClock()
        self._zero = self._real.now()
        """Real time of the virtual time 0."""

    def sleep(self, duration: float) -> None:
        """See `Clock.sleep`."""
        super().sleep(duration)
        self._wait()

    def sleep_until(self, when: float) -> None:
        """See `VirtualClock.sleep_until`."""
        super().sleep_until(when)
        self._wait()

    def _wait(self) -> None:
        with self._lock:
            ahead = self._now - (self._real.now() - self._zero)
            if ahead < -_BEHIND:
                self._zero -= ahead
        self._real.sleep(ahead)
