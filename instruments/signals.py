"""What asks a program to stop: held back while a rig is brought to its safe state, and turned into a
way out through every context where it would end the program at once.
"""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["STOPPING", "at_console_close", "deliver", "ending_in_order", "uninterrupted"]

STOPPING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)
"""What asks a program to stop: Ctrl-C, an orderly end, a closed terminal, a closed Windows console."""


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back what asks the program to stop: nothing inside is cut short by it.

    What arrives meanwhile is delivered once at the end, or where `deliver` is called, unless an error
    comes out: that the safe state was not reached matters more than that somebody was impatient. Only
    the main thread sees signals; in any other thread this does nothing.
    """
    global _held  # noqa: PLW0603  as below
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with ending_in_order():
        if not _held:
            _arrived.clear()
        _held += 1
        try:
            yield
        except BaseException:
            if _held == 1:
                _arrived.clear()
            raise
        finally:
            _held -= 1
        if not _held:
            deliver()


def deliver() -> None:
    """Let what is held back stop the program here: between two blocks of a play, say."""
    if _arrived and threading.current_thread() is threading.main_thread():
        first = _arrived[0]
        _arrived.clear()
        _act(first, None)


@contextmanager
def ending_in_order() -> Iterator[None]:
    """While it lasts, SIGTERM and its kind leave the program through every context, by SystemExit.

    Left to themselves they end it where it stands, with the output on. What a program has arranged
    for them is done as ever; where this is not the main thread, nothing is changed.
    """
    global _orderly  # noqa: PLW0603  handlers belong to the process, and so does who counts on them
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _orderly += 1
    try:
        for kind in STOPPING:
            before = signal.getsignal(kind)
            if before not in (_handle, signal.SIG_IGN, None):
                _before[kind] = before
                signal.signal(kind, _handle)
        yield
    finally:
        _orderly -= 1
        if not _orderly and threading.current_thread() is threading.main_thread():
            for kind in STOPPING:
                if signal.getsignal(kind) is _handle:
                    signal.signal(kind, _before[kind])


_orderly = 0
_held = 0
_arrived: list[int] = []
_before: dict[int, Any] = {}
"""What was arranged for a signal before ours."""


def _handle(number: int, frame: FrameType | None) -> None:
    """The one handler, which stays in place all the while.

    To hold signals back is to count, then, and no moment lies between two handlers. It is harmless
    where it is left behind: it does what was arranged before.
    """
    if _held:
        _arrived.append(number)
    else:
        _act(number, frame)


def _act(number: int, frame: FrameType | None) -> None:
    before = _before[number]
    if callable(before):
        before(number, frame)
    elif _orderly:
        raise SystemExit(128 + number)
    else:
        signal.signal(number, before)
        signal.raise_signal(number)


@contextmanager
def at_console_close(action: Callable[[], object]) -> Iterator[None]:
    """While it lasts, closing the console on Windows (or logging off) first does `action`.

    Windows ends the program when its handler returns, or after five seconds, so that the handler
    itself must do what is to be done; a signal's would come too late. Elsewhere a closed terminal
    is SIGHUP, and this does nothing.
    """
    kernel: Any = getattr(ctypes, "windll", None)
    if kernel is None:
        yield
        return
    kind = getattr(ctypes, "WINFUNCTYPE", ctypes.CFUNCTYPE)(ctypes.c_int, ctypes.c_uint)
    handler = kind(lambda event: closing(event, action))
    kernel.kernel32.SetConsoleCtrlHandler(handler, 1)
    try:
        yield
    finally:
        kernel.kernel32.SetConsoleCtrlHandler(handler, 0)


def closing(event: int, action: Callable[[], object]) -> int:
    """What Windows calls: do `action` when the console goes (close, log off, shut down); 0 goes on."""
    if event in _GOING:
        try:
            action()
        except Exception as error:
            print(f"Error: {error}", file=sys.stderr, flush=True)
    return 0


_GOING = (2, 5, 6)
"""CTRL_CLOSE_EVENT, CTRL_LOGOFF_EVENT and CTRL_SHUTDOWN_EVENT."""
