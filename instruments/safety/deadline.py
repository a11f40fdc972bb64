"""Deadlines on the way to the safe state: a step that hangs must not keep the others from being taken."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from typing import TypeVar

from ...base.errors import InstrumentError

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
