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

__all__ = ["STOPPING", "at_console_close", "ending_in_order", "uninterrupted"]

STOPPING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)
"""What asks a program to stop: Ctrl-C, an orderly end, a closed terminal, a closed Windows console."""


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let no signal cut short what brings the rig to its safe state.

    A signal that arrives meanwhile is delivered once at the end, unless an error comes out: that the
    safe state was not reached matters more than that somebody was impatient. Only the main thread
    sees signals; in any other thread this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    before = {kind: signal.getsignal(kind) for kind in STOPPING}
    for kind in STOPPING:
        try:
            signal.signal(kind, lambda number, _frame: arrived.append(number))
        except KeyboardInterrupt:
            # One more, just before it was held back: what must be done comes first all the same.
            signal.signal(kind, lambda number, _frame: arrived.append(number))
            arrived.append(signal.SIGINT)
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
    if arrived:
        signal.raise_signal(arrived[0])


@contextmanager
def ending_in_order() -> Iterator[None]:
    """While it lasts, SIGTERM and its kind leave the program through every context, by SystemExit.

    Left to themselves they end it where it stands, with the output on. What a program has arranged
    for them is left alone; so is everything when this is not the main thread.
    """
    global _orderly  # noqa: PLW0603  handlers belong to the process, and so does who counts on them
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _orderly += 1
    for kind in STOPPING:
        if signal.getsignal(kind) is signal.SIG_DFL:
            signal.signal(kind, _end)
    try:
        yield
    finally:
        _orderly -= 1
        if not _orderly and threading.current_thread() is threading.main_thread():
            for kind in STOPPING:
                if signal.getsignal(kind) is _end:
                    signal.signal(kind, signal.SIG_DFL)


_orderly = 0


def _end(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


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
