"""Ways out of a program: hold stop signals back while a rig reaches its safe state, turn them into SystemExit
where they would end the program at once, so that every context is exited, raise them again where Python has
dropped them, and act where no context is.

A stop is an exception, as Python's own Ctrl-C is, and not a flag that every loop has to look at: a loop or a
wait that forgot to, or one of another package, would not end. What speaks against exceptions is that Python
drops one that comes in a destructor; `dropping_none` is told of each.
"""

from __future__ import annotations

import _thread
import atexit
import ctypes
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from .clock import RealClock

STOPPING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)
"""The stop signals: Ctrl-C, termination, a closed terminal, a closed Windows console."""


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back stop signals within the context.

    A signal that arrives meanwhile is delivered once at the end, or where `deliver` is called, unless
    the body raises: an unconfirmed safe state matters more than a Ctrl-C. Only the main thread
    receives signals; in any other thread this does nothing.
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
    """Deliver a signal that is held back, for example between two blocks of a play."""
    if _arrived and threading.current_thread() is threading.main_thread():
        first = _arrived[0]
        _arrived.clear()
        _act(first, None)


@contextmanager
def ending_in_order() -> Iterator[None]:
    """Make stop signals such as SIGTERM raise SystemExit within the context, so that others are exited.

    By default they end the program at once, with the output on. Handlers that the program has
    installed are still called; outside the main thread, nothing is changed.
    """
    global _orderly  # noqa: PLW0603  handlers belong to the process, and so does the count of their users
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
        with dropping_none():
            yield
    finally:
        _orderly -= 1
        if not _orderly and threading.current_thread() is threading.main_thread():
            for kind in STOPPING:
                if signal.getsignal(kind) is _handle:
                    signal.signal(kind, _before[kind])


class _Stopped(SystemExit):
    """A stop signal that would have ended the program at once."""


@contextmanager
def dropping_none() -> Iterator[None]:
    """Raise a stop again that Python drops within the context, until one is heeded.

    An exception that comes in a destructor, in a callback of a weak reference or of the garbage collector
    goes nowhere: Python shows it to `sys.unraisablehook`, and the program goes on. Each call by gRPC ends in
    such a destructor. The same signal is then sent again.
    """
    global _dropped_before
    if sys.unraisablehook is not _dropped:
        _dropped_before, own = sys.unraisablehook, True
        sys.unraisablehook = _dropped
    else:
        own = False
    try:
        yield
    finally:
        if own and sys.unraisablehook is _dropped:
            sys.unraisablehook = _dropped_before


def _dropped(what: Any) -> None:
    number = _number_of(what.exc_value)
    if number is None or threading.current_thread() is not threading.main_thread():
        _dropped_before(what)
        return
    try:
        # Not by `threading`: the destructor may have come while the program holds one of its locks.
        _thread.start_new_thread(_send_again, (number,))
    except RuntimeError:  # the interpreter is shutting down
        _dropped_before(what)


def _number_of(stop: BaseException | None) -> int | None:
    """The signal behind an exception; None for any other."""
    told = stop.args[0] if stop is not None and stop.args else 0
    if isinstance(stop, KeyboardInterrupt):
        return told if told in STOPPING else signal.SIGINT
    return told - 128 if isinstance(stop, _Stopped) else None


def _send_again(number: int) -> None:
    clock, before = RealClock(), _heard
    for _ in range(_TIMES):
        clock.sleep(_SOON)
        # One that came just before a wait of the main thread would be heard after it.
        if _heard != before:
            return
        if hasattr(signal, "pthread_kill"):  # a signal to this thread would not end a wait of the main one
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        else:
            signal.raise_signal(number)
        if not isinstance(signal.getsignal(number), Heard):
            return


class Heard:
    """A handler of a stop signal that counts its calls: `dropping_none` sends a signal until it is heard."""

    def __init__(self, handler: Callable[[int, FrameType | None], object]) -> None:
        self._handler = handler

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Be called by Python."""
        global _heard  # noqa: PLW0603  as below
        _heard += 1
        at = frame
        while at is not None:
            # What the hook itself raises is dropped without a hook: send this stop once more.
            if at.f_code is _dropped.__code__:
                _thread.start_new_thread(_send_again, (number,))
                return
            at = at.f_back
        self._handler(number, frame)


_SOON, _TIMES = 0.02, 50
"""Time (s) in which what has dropped a stop ends, and between two signals; most signals."""
_heard = 0
_dropped_before: Callable[[Any], object] = sys.unraisablehook
_orderly = 0
_held = 0
_arrived: list[int] = []
_before: dict[int, Any] = {}
"""The handlers installed before ours."""


def _handled(number: int, frame: FrameType | None) -> None:
    """Handle every stop signal, whether held back or not.

    With a single handler, holding back is a counter, without a gap between two handlers. Left
    installed, it is harmless: it calls the earlier handler.
    """
    if _held:
        _arrived.append(number)
    else:
        _act(number, frame)


_handle = Heard(_handled)


def _act(number: int, frame: FrameType | None) -> None:
    before = _before[number]
    if callable(before):
        before(number, frame)
    elif _orderly:
        raise _Stopped(128 + number)
    else:
        signal.signal(number, before)
        signal.raise_signal(number)


@contextmanager
def at_program_end(action: Callable[[], object]) -> Iterator[None]:
    """Call `action` when the program ends and nobody has left the context; not in a forked child.

    The program ends when its main thread, its executors and its other threads have: they may use what the
    action closes. Daemons still run then, and threads can be started, which a deadline needs. When the
    functions of `atexit` are called, none can be (Python 3.12).
    """
    ending = (os.getpid(), action)
    _endings.append(ending)
    try:
        yield
    finally:
        _endings.remove(ending)


def _end() -> None:
    ended = (threading.main_thread(), threading.current_thread())
    try:
        while others := [t for t in threading.enumerate() if not t.daemon and t not in ended]:
            others[0].join()
    finally:  # after Ctrl-C too
        for process, action in reversed(_endings.copy()):
            if process == os.getpid():
                try:
                    action()
                except BaseException:  # of one rig: the others are closed as well
                    traceback.print_exc()


_endings: list[tuple[int, Callable[[], object]]] = []
# Before Python joins all threads, and after whatever else ends threads there, such as executors. `atexit` is
# left where an error ends that.
getattr(threading, "_threading_atexits", []).insert(0, _end)
atexit.register(_end)


@contextmanager
def at_console_close(action: Callable[[], object]) -> Iterator[None]:
    """Call `action` first when the Windows console is closed, or the user logs off, within the context.

    Windows ends the program when its handler returns, or after five seconds, so the handler itself
    must call `action`; a signal handler would run too late. Elsewhere a closed terminal
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
    """Windows' console handler: call `action` on close, log off and shutdown; 0 calls the next handler."""
    if event in _GOING:
        try:
            action()
        except Exception as error:
            print(f"Error: {error}", file=sys.stderr, flush=True)
    return 0


_GOING = (2, 5, 6)
"""CTRL_CLOSE_EVENT, CTRL_LOGOFF_EVENT and CTRL_SHUTDOWN_EVENT."""
