"""A queue from other threads to one: putting in never waits, and the wait for an item can be interrupted."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

from .flag import Flag

Item = TypeVar("Item")

_SLICE = 0.1
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

    def wait(self, seconds: float = _SLICE) -> bool:
        """Wait for an item or the end, once and for `seconds` or a tenth of one; return True for an item."""
        # Cleared before the look: what comes after the look ends the wait.
        self._changed.clear()
        if not self._items and not self._ended:
            self._changed.wait(min(seconds, _SLICE))
        return bool(self._items)

    def head(self) -> Item:
        """Return the oldest item, which stays. Raises IndexError without one."""
        return self._items[0]

    def take(self) -> Item:
        """Take the oldest item. Raises IndexError without one."""
        return self._items.popleft()
