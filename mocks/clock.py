"""Virtual time: a wait advances it at once, so nothing in a simulated rig sleeps, unless a person watches."""

from __future__ import annotations

from ..base.clock import RealClock, VirtualClock

__all__ = ["RealTimeClock", "VirtualClock"]

_BEHIND = 0.1
"""Lag behind real time (s) beyond which a `RealTimeClock` does not catch up."""


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
