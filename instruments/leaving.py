"""Leaving in time: what brings a rig to its safe state may hang, and must not keep the rest from it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from typing import TypeVar

from instruments.errors import InstrumentError

__all__ = ["in_time", "left_in_time"]

Value = TypeVar("Value")

DEADLINE = 5.0
"""Real seconds that one step may take: a box whose relay cannot be told has opened by itself by then."""


def in_time(what: str, action: Callable[[], object]) -> None:
    """Return or raise what `action` does; TimeoutError when it does neither before `DEADLINE`.

    It runs in a thread of its own, which is left behind when it hangs.
    """
    outcome: Future[object] = Future()

    def run() -> None:
        try:
            outcome.set_result(action())
        except BaseException as error:
            outcome.set_exception(error)

    thread = threading.Thread(target=run, name=what, daemon=True)
    try:
        thread.start()
    except RuntimeError:
        # The interpreter is going down and starts no thread any more: late is better than never.
        run()
    else:
        thread.join(DEADLINE)
    if not outcome.done():
        raise TimeoutError(f"{what} hangs: it had not ended after {DEADLINE:g} s.")
    outcome.result()


@contextmanager
def left_in_time(what: str, context: AbstractContextManager[Value]) -> Iterator[Value]:
    """`context`, whose exit's hanging is an InstrumentError."""
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
        in_time(what, leave)
    except TimeoutError as error:
        raise InstrumentError(str(error)) from None
