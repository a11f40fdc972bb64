"""Output terminals: the present value, past values and future steps of each."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..base.arrays import FloatArray
from .nodes import Run

_MEMORY = 60.0
"""Past for which a terminal's values are kept (s)."""
_EDGE = 1e-6
"""Tolerance for counting a clock edge as reached, as a fraction of the period: it absorbs rounding."""


@dataclass
class Timebase:
    """A sample clock: its edges from the moment it starts until it stops."""

    rate_hz: float
    start: float | None = None
    """Time of edge 0 (s); None before the start."""
    total: int | None = None
    """Number of edges after which it stops; None for no limit."""
    stopped: float | None = None

    def edges(self, now: float) -> int:
        """Return the number of edges up to `now` (s)."""
        if self.start is None:
            return 0
        until = now if self.stopped is None else min(now, self.stopped)
        count = max(0, int(np.floor((until - self.start) * self.rate_hz + _EDGE)) + 1)
        if until < self.start - _EDGE / self.rate_hz:
            return 0
        return count if self.total is None else min(count, self.total)

    def time(self, edge: int) -> float | None:
        """Return the time of edge `edge` (s); None if never or unknown."""
        if self.start is None or (self.total is not None and edge >= self.total):
            return None
        when = self.start + edge / self.rate_hz
        return when if self.stopped is None or when <= self.stopped else None


class OutputTerminal:
    """One analog output or digital line. Its own lock allows the plant to call `take` at any time."""

    def __init__(self, wired: bool = False) -> None:
        self._wired = wired
        self._lock = threading.Lock()
        self._past: deque[Run] = deque([Run(-np.inf, np.inf, np.zeros(1))])
        self._new: deque[Run] = deque()
        self._clock: Timebase | None = None
        self._offset = 0
        self._made = 0
        self._limit: int | None = None
        self._data: FloatArray = np.zeros(0)
        self._dropped = 0
        self._repeat = True
        self.driven = False
        """True once a value has been written."""

    def watch(self) -> None:
        """Keep the steps from now on until they are taken."""
        with self._lock:
            self._wired = True

    def hold(self, value: float, now: float) -> None:
        """Step to `value` at `now` (s) and hold it."""
        with self._lock:
            self._advance(now)
            self._append(Run(now, np.inf, np.array([float(value)])))

    def play(self, data: FloatArray, clock: Timebase, offset: int, limit: int | None, repeat: bool) -> None:
        """Step through `data` on the clock's edges from edge `offset`, at most `limit` steps.

        With `repeat` the data repeat; otherwise the last value is held until more data come.
        """
        with self._lock:
            self._clock, self._offset, self._limit = clock, offset, limit
            self._data, self._repeat, self._made, self._dropped = data, repeat, 0, 0

    def replace(self, data: FloatArray, now: float, dropped: int = 0) -> None:
        """Replace the data from the step after `now` (s) on; `data` omits the first `dropped` steps."""
        with self._lock:
            self._advance(now)
            self._data, self._dropped = data, dropped

    def stop(self, now: float) -> None:
        """Stop stepping at `now` (s); the value is held."""
        with self._lock:
            self._advance(now)
            self._clock = None

    def take(self, until: float) -> Sequence[Run]:
        """See `nodes.Source.take`."""
        with self._lock:
            self._advance(until)
            runs = []
            while self._new and self._new[0].start <= until:
                run = self._new.popleft()
                due = int(np.floor((until - run.start) / run.period + _EDGE)) + 1
                if due < len(run.values):
                    rest = Run(run.start + due * run.period, run.period, run.values[due:])
                    self._new.appendleft(rest)
                runs.append(Run(run.start, run.period, run.values[:due]))
            return runs

    def at(self, times: FloatArray) -> FloatArray:
        """Return the values held at `times` (s, rising and not in the future)."""
        with self._lock:
            if len(times):
                self._advance(float(times[-1]))
            values = np.empty(len(times))
            missing = np.ones(len(times), dtype=np.bool_)
            for run in reversed(self._past):
                here = missing & (times >= run.start)
                if here.any():
                    missing &= ~here
                    step = np.zeros(len(times), dtype=np.int64)
                    if np.isfinite(run.start):
                        step[here] = np.floor((times[here] - run.start) / run.period + _EDGE)
                    values[here] = run.values[np.minimum(step[here], len(run.values) - 1)]
                if not missing.any():
                    break
            return values

    def _advance(self, until: float) -> None:
        """Make the steps that are due at `until` (s)."""
        clock = self._clock
        if clock is None or clock.start is None or not len(self._data):
            return
        due = clock.edges(until) - self._offset
        if self._limit is not None:
            due = min(due, self._limit)
        if not self._repeat:
            due = min(due, self._dropped + len(self._data))
        if due <= self._made:
            return
        steps = np.arange(self._made, due)
        values = self._data[steps % len(self._data) if self._repeat else steps - self._dropped]
        start = clock.start + (self._offset + self._made) / clock.rate_hz
        self._made = due
        self._append(Run(start, 1 / clock.rate_hz, values))

    def _append(self, run: Run) -> None:
        self.driven = True
        self._past.append(run)
        if self._wired:
            self._new.append(run)
        while len(self._past) > 1 and self._past[1].start < run.start - _MEMORY:
            self._past.popleft()
