"""Signals held back while a rig is brought to its safe state."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["STOPPING", "uninterrupted"]

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
