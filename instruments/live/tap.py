"""Taps: the blocks of a running recording or play, for a viewer that can never slow it down.

Why no callback: a viewer's code would then run in the thread that reads or writes samples. A tap is a
bounded queue instead. Publishing appends a reference and returns, whatever the viewer does.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self, TypeVar

from haploop.instruments.arrays import BoolArray, FloatArray
from haploop.instruments.clock import Clock, RealClock
from haploop.instruments.daq import Block
from haploop.instruments.sensors import Sensors

__all__ = ["Feed", "LiveBlock", "Run", "Tap"]

Array = TypeVar("Array", FloatArray, BoolArray)

_POLL = 0.1
"""Seconds of one wait: on Windows a wait without an end does not see Ctrl-C."""


@dataclass(frozen=True)
class Run:
    """One recording or play: what its blocks have in common."""

    rig: str
    simulated: bool
    doing: str
    """"record" or "play"."""
    about: str
    """Path of the recording, or the patches that are played."""
    channels: tuple[str, ...]
    rate_hz: float
    sensors: Sensors
    """Sensors of the rig, which turn volts of `channels` into SI."""
    laser: tuple[str, float] | None
    """Channel of the vibrometer and its scale (m/s per V)."""
    number: int = 0
    """Counts the recordings and plays of an open rig, from 1."""


@dataclass(frozen=True, eq=False)
class LiveBlock:
    """Consecutive samples of a run: (channels, samples) V, read-only, and (channels,) overload flags.

    `first` is the index of the first sample since the run began. A block that was dropped is missing from
    the indices.
    """

    run: Run
    first: int
    volts: FloatArray
    overload: BoolArray

    @property
    def end(self) -> int:
        """Index of the sample that follows this block."""
        return self.first + int(self.volts.shape[1])


class Tap:
    """The newest blocks, at most `capacity` of them. When it is full, each new block replaces the oldest.

    One thread takes blocks; make a tap for each viewer. Time-outs count on `clock`. A context, whose exit
    closes the tap.
    """

    def __init__(
        self, capacity: int = 16, clock: Clock | None = None, on_close: Callable[[], None] = lambda: None
    ) -> None:
        if capacity < 1:
            raise ValueError(f"A tap holds 1 block or more, not {capacity}.")
        # No lock is shared with the viewer: an append to a full deque drops the oldest in one step.
        self._queue: deque[LiveBlock] = deque(maxlen=capacity)
        self._clock = clock or RealClock()
        self._on_close = on_close
        self._available = threading.Event()
        self._offered = self._taken = 0
        self._closed = False
        self._error: Exception | None = None

    @property
    def dropped(self) -> int:
        """Number of blocks that were replaced or skipped before they were taken."""
        return max(0, self._offered - self._taken - len(self._queue))

    @property
    def closed(self) -> bool:
        """Whether no further block will come; those that wait can still be taken."""
        return self._closed

    def offer(self, block: LiveBlock, missed: int = 0) -> None:
        """Put a block in, before which `missed` others were dropped elsewhere. Never waits."""
        # Counted afterwards: for a moment, `dropped` may be one too few and never one too many.
        self._queue.append(block)
        self._offered += 1 + missed
        self._available.set()

    def take(self, timeout: float | None = None) -> LiveBlock | None:
        """The oldest block that waits; None after `timeout` seconds without one, or when the tap is closed.

        None as the time-out waits until the tap is closed. Raises the error that the tap was ended with.
        """
        until = None if timeout is None else self._clock.now() + timeout
        while True:
            self._available.clear()
            try:
                block = self._queue.popleft()
            except IndexError:
                if self._closed:
                    if self._error is not None:
                        raise self._error from None
                    return None
            else:
                self._taken += 1
                return block
            left = _POLL if until is None else min(_POLL, until - self._clock.now())
            if left <= 0:
                return None
            self._available.wait(left)

    def latest(self) -> LiveBlock | None:
        """The newest block, without waiting; older ones are dropped. None when none has come since."""
        newest = None
        for _ in range(len(self._queue)):
            try:
                newest = self._queue.popleft()
            except IndexError:
                break
        if newest is not None:
            self._taken += 1
        elif self._closed and self._error is not None:
            raise self._error
        return newest

    def __iter__(self) -> Iterator[LiveBlock]:
        """Each block that is not dropped, until the tap is closed."""
        while (block := self.take()) is not None:
            yield block

    def close(self, error: Exception | None = None) -> None:
        """Take no further blocks; `error` is raised to the viewer once it has taken those that wait."""
        if not self._closed:
            self._error = error
            self._closed = True
            self._available.set()
            self._on_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Feed:
    """Hands the blocks of each run on a rig to the rig's taps. Without a tap it does nothing."""

    def __init__(self) -> None:
        # Replaced as a whole, so that publishing needs no lock.
        self._taps: tuple[Tap, ...] = ()
        self._changing = threading.Lock()
        self._runs = 0
        self._closed = False

    def tap(self, capacity: int = 16) -> Tap:
        """A new tap on all further blocks. Once the feed is closed, it is a closed one."""
        tap = Tap(capacity, on_close=lambda: self._remove(tap))
        with self._changing:
            self._taps = (*self._taps, tap)
        if self._closed:
            tap.close()
        return tap

    def begin(self, run: Run) -> Callable[[Block], None]:
        """Begin a run. Returns the function that publishes each of its blocks, and never waits."""
        self._runs += 1
        run = replace(run, number=self._runs)

        def publish(block: Block) -> None:
            if not self._taps:
                return
            live = LiveBlock(run, block.first, _read_only(block.volts), _read_only(block.overload))
            for tap in self._taps:
                tap.offer(live)

        return publish

    def close(self) -> None:
        """Close every tap. May be called again."""
        self._closed = True
        for tap in self._taps:
            tap.close()

    def _remove(self, tap: Tap) -> None:
        with self._changing:
            self._taps = tuple(other for other in self._taps if other is not tap)


def _read_only(values: Array) -> Array:
    """A view through which no viewer can change what others look at."""
    view: Array = values.view()
    view.flags.writeable = False
    return view
