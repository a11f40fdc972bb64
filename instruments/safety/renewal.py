"""Renewal of a relay box's dead-man time while a play is alive.

A box opens by itself when it is not renewed. In real time a thread of its own renews it, so that a block that
is late, because a machine is busy or a view is drawn, ends no play; but it renews only while the play is
alive, so that one that hangs keeps no contact closed.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from ...base.clock import Clock
from ...base.flag import Flag
from ..relay import Relay
from .deadline import DEADLINE

_OFTEN = 5
"""Renewals in one dead-man time: the thread may be late by four fifths of it."""
_ALIVE = 0.5
"""Longest time between two blocks, in dead-man times: beyond it the box is not renewed."""


class Renewal:
    """Renews a relay while its context lasts and `alive` is called. On a virtual clock `alive` itself renews.

    Real time: the box opens at the latest one and a half dead-man times after the last call of `alive`.
    """

    def __init__(self, relay: Relay, clock: Clock) -> None:
        self._relay = relay
        self._clock = clock
        self._own = clock.real and relay.dead_man < threading.TIMEOUT_MAX
        self._ended = Flag()
        self._failure: Exception | None = None
        self._seen = clock.now()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Renew until the context ends; the box is not touched after it."""
        if not self._own:
            yield
            return
        self._seen = self._clock.now()
        thread = threading.Thread(target=self._renew, name="renewal of the dead-man", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._ended.set()
            thread.join(DEADLINE)

    def alive(self) -> None:
        """Say that the play goes on. Raises what a renewal raised, as for a channel that has opened."""
        self._seen = self._clock.now()
        if not self._own:
            self._relay.renew()
        elif self._failure is not None:
            raise self._failure

    def _renew(self) -> None:
        while not self._clock.wait(self._ended, self._relay.dead_man / _OFTEN):
            if self._clock.now() - self._seen <= _ALIVE * self._relay.dead_man:
                try:
                    self._relay.renew()
                except Exception as error:
                    self._failure = error
                    return
