"""Flags and queues between threads that no interrupt can tear, and a context whose exit closes it.

`threading.Event` takes its lock in steps of Python. A Ctrl-C between two of them leaves the lock taken, and
whoever sets, clears or waits next hangs: the way out, too. Here each step on the lock is one call into C,
which an interrupt comes before or after. (So is `with lock`, but not `with condition`: enter a condition by
its lock.)
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import Generic, Self, TypeVar

_SLICE = 0.1
"""Longest single wait (s): on Windows, Ctrl-C interrupts none. A wait that is interrupted just after it ended
costs others no more than this."""


class Flag:
    """Up or down, and waited for until it is up. What is up for a moment only can be missed."""

    def __init__(self) -> None:
        self._up = False
        # Taken while the flag is down.
        self._gate = threading.Lock()
        self._gate.acquire()

    def is_set(self) -> bool:
        """Return True while the flag is up."""
        return self._up

    def set(self) -> None:
        """Put the flag up. Never waits."""
        self._up = True
        self._open()

    def clear(self) -> None:
        """Take the flag down. Never waits."""
        self._up = False
        self._gate.acquire(blocking=False)

    def wait(self, duration: float) -> bool:
        """Wait until the flag is up, at most `duration` s of real time; return True when it is."""
        while not self.is_set() and duration > 0:
            if self._gate.acquire(timeout=min(duration, _SLICE)) and self.is_set():
                self._open()  # for the next who waits
            duration -= _SLICE
        return self.is_set()

    def _open(self) -> None:
        with suppress(RuntimeError):  # it is open
            self._gate.release()


# A queue from other threads to one: putting in never waits, and the wait for an item can be interrupted.

Item = TypeVar("Item")

_WAIT = 0.1
"""Longest single wait (s): on Windows, Ctrl-C does not interrupt a wait without a time-out."""


class Inbox(Generic[Item]):
    """Items in the order in which they were put in. One thread waits and takes.

    With `most`, a new item replaces the oldest of a full inbox.
    """

    def __init__(self, most: int | None = None) -> None:
        # No lock is shared with the taker: an append to a full deque drops the oldest in one step.
        self._items: deque[Item] = deque(maxlen=most)
        self._changed = Flag()
        self._ended = False

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[Item]:
        """Look at the items, which stay: only while none is put in."""
        return iter(self._items)

    @property
    def ended(self) -> bool:
        """True when no item will come any more; those that are there can still be taken."""
        return self._ended

    def put(self, item: Item) -> None:
        """Put an item in. Never waits."""
        self._items.append(item)
        self._changed.set()

    def end(self) -> None:
        """Say that no item will come any more, to who waits too."""
        self._ended = True
        self._changed.set()

    def wait(self, seconds: float = _WAIT) -> bool:
        """Wait for an item or the end, once and for `seconds` or a tenth of one; return True for an item."""
        # Cleared before the look: what comes after the look ends the wait.
        self._changed.clear()
        if not self._items and not self._ended:
            self._changed.wait(min(seconds, _WAIT))
        return bool(self._items)

    def head(self) -> Item:
        """Return the oldest item, which stays. Raises IndexError without one."""
        return self._items[0]

    def take(self) -> Item:
        """Take the oldest item. Raises IndexError without one."""
        return self._items.popleft()


# A context whose exit closes it.


class Closing:
    """Base of what has a `close` that may be called again: a context, whose exit calls it."""

    def close(self) -> None:
        """Give up what is held. May be called again."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
