"""Looks at a contact that is closed outside a play, as long as it is closed.

In a play the abort monitor looks at every block. Outside, nobody may ask for anything while a contact is
closed, and a box without a dead-man never opens by itself: so a thread looks, in real time. On a virtual
clock, which stands still while nobody waits, each renewal looks.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress

from ...base.clock import Clock
from ...base.errors import HaploopError
from ...base.flag import Flag
from .deadline import DEADLINE

_OFTEN = 0.2
"""Interval of the looks (s)."""


class Watch:
    """Calls `look` until `end`, whatever it raises: a contact may not open, and some wirings have none."""

    def __init__(self, clock: Clock, look: Callable[[], None]) -> None:
        self.on = False
        """True while a contact is closed outside a play."""
        self._clock = clock
        self._look = look
        self._ended = Flag()
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Start to look."""
        self.on = True
        if self._clock.real:
            self._ended = Flag()
            self._thread = threading.Thread(
                target=self._run, args=(self._ended,), name="watch of a closed contact", daemon=True
            )
            self._thread.start()

    def end(self) -> None:
        """Look no more. Idempotent."""
        self.on = False
        self._ended.set()
        thread, self._thread = self._thread, None
        if thread not in (None, threading.current_thread()):
            thread.join(DEADLINE)

    def _run(self, ended: Flag) -> None:
        while not self._clock.wait(ended, _OFTEN):
            with suppress(HaploopError):
                self._look()
