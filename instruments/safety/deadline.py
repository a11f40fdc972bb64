"""Deadlines on the way to the safe state, and looks at a contact while it is closed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import TypeVar

from ...base.clock import Clock
from ...base.errors import HaploopError, InstrumentError
from ...base.threads import Flag
from ..relay import Relay

Value = TypeVar("Value")

DEADLINE = 5.0
"""Time for one step (real s): by then a relay box that cannot be reached has opened by itself."""


def run_within(what: str, action: Callable[[], object]) -> None:
    """Run `action`, and raise its error; raise TimeoutError when it has not ended within `DEADLINE`.

    It runs in a thread of its own, which is abandoned when it hangs.
    """
    outcome: Future[object] = Future()

    def run() -> None:
        try:
            outcome.set_result(action())
        except Exception as error:
            outcome.set_exception(error)
        except BaseException as error:
            # A driver that calls sys.exit does not end the program before every step was taken.
            told = InstrumentError(f"{what} raised {type(error).__name__}: {error}.")
            told.__cause__ = error
            outcome.set_exception(told)

    thread = threading.Thread(target=run, name=what, daemon=True)
    try:
        thread.start()
    except RuntimeError:
        # The interpreter is shutting down and starts no thread any more: run it without a deadline.
        run()
    else:
        thread.join(DEADLINE)
    if not outcome.done():
        raise TimeoutError(f"{what} hangs: it had not ended after {DEADLINE:g} s.")
    outcome.result()


@contextmanager
def exit_within(what: str, context: AbstractContextManager[Value]) -> Iterator[Value]:
    """Enter `context`; its exit is an InstrumentError when it has not ended within `DEADLINE`."""
    value = context.__enter__()
    try:
        yield value
    except BaseException as error:
        raised = error
        _exit(what, lambda: context.__exit__(type(raised), raised, raised.__traceback__))
        raise
    else:
        _exit(what, lambda: context.__exit__(None, None, None))


def _exit(what: str, leave: Callable[[], object]) -> None:
    try:
        run_within(what, leave)
    except TimeoutError as error:
        raise InstrumentError(str(error)) from None


# Looks at a contact that is closed outside a play, as long as it is closed.
#
# In a play the abort monitor looks at every block. Outside, nobody may ask for anything while a contact is
# closed, and a box without a dead-man never opens by itself: so a thread looks, in real time. On a virtual
# clock, which stands still while nobody waits, each renewal looks.

_LOOK_EVERY = 0.2
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
        while not self._clock.wait(ended, _LOOK_EVERY):
            with suppress(HaploopError):
                self._look()


# Renewal of a relay box's dead-man time while a play is alive.
#
# A box opens by itself when it is not renewed. In real time a thread of its own renews it, so that a block
# that is late, because a machine is busy or a view is drawn, ends no play; but it renews only while the play
# is alive, so that one that hangs keeps no contact closed.

_RENEWALS = 5
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
        while not self._clock.wait(self._ended, self._relay.dead_man / _RENEWALS):
            if self._clock.now() - self._seen <= _ALIVE * self._relay.dead_man:
                try:
                    self._relay.renew()
                except Exception as error:
                    self._failure = error
                    return
