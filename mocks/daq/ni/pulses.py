"""Digital signals as edges: pulse trains of counter outputs, and signals that a test or a plant sets.

A signal is asked for its transitions in an interval of the past, or of any time where they are known. A pulse
is high first and low after; before the first and after the last a train is at its idle level. (NI's own test
of buffered pulse reads sees a train that idles high from its second pulse on, which this order gives.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ....base.arrays import BoolArray, FloatArray

_GRID = 1e-5
"""Interval at which a function of time is looked at (s): shorter pulses are missed."""


@dataclass(frozen=True, eq=False)
class Transitions:
    """Changes of a digital signal: (changes,) s, rising, and the level after each."""

    times: FloatArray
    levels: BoolArray

    def to(self, level: bool) -> FloatArray:
        """Times of the changes to `level`."""
        return np.asarray(self.times[self.levels == level])


class Train(Protocol):
    """What stands at a terminal from `start` until it is `stopped` (s)."""

    start: float
    stopped: float

    def transitions(self, begin: float, end: float) -> Transitions:
        """Return the changes in (`begin`, `end`] (s)."""


@dataclass(eq=False)
class PulseTrain:
    """Pulses that follow one another from `start` on. Times in s."""

    start: float
    high: FloatArray
    low: FloatArray
    total: int | None
    """Number of pulses; None for a train that repeats its pulses until it is stopped."""
    idle: bool = False
    stopped: float = np.inf

    @property
    def cycle(self) -> float:
        """Duration of all given pulses together."""
        return float(np.sum(self.high + self.low))

    @property
    def end(self) -> float:
        """Time when the last pulse is over."""
        if self.total is None:
            return self.stopped
        whole, rest = divmod(self.total, len(self.high))
        return min(
            self.stopped, self.start + whole * self.cycle + float(np.sum((self.high + self.low)[:rest]))
        )

    def begun(self, now: float) -> int:
        """Number of pulses that have begun by `now`."""
        return len(self._pulses(-np.inf, now)[0])

    def next_end(self, now: float) -> float:
        """Time when the pulse of `now` is over."""
        starts, _, lows = self._pulses(now - self.cycle, now)
        return float(starts[-1] + lows[-1]) if len(starts) else self.start

    def transitions(self, begin: float, end: float) -> Transitions:
        """Return the changes in (`begin`, `end`]."""
        starts, highs, whole = self._pulses(begin - 2 * self.cycle, end)
        times = np.column_stack([starts, starts + highs]).ravel()
        levels = np.tile([True, False], len(starts))
        if self.idle and len(starts):
            # The first high part continues the idle level, and the last pulse returns to it.
            if starts[0] == self.start:
                times, levels = times[1:], levels[1:]
            if self.end <= end:
                times, levels = np.append(times, starts[-1] + whole[-1]), np.append(levels, True)
        kept = (times > begin) & (times <= end) & (times < self.stopped)
        return Transitions(times[kept], levels[kept])

    def _pulses(self, begin: float, end: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Starts, high parts and durations of the pulses that begin in [`begin`, `end`]."""
        period, count = self.cycle, len(self.high)
        first = max(0, int((max(begin, self.start) - self.start) // period) * count)
        last = int((min(end, self.stopped) - self.start) // period + 1) * count if end >= self.start else 0
        if self.total is not None:
            last = min(last, self.total)
        index = np.arange(first, max(first, last))
        durations = self.high + self.low
        offsets = np.concatenate([[0.0], np.cumsum(durations)[:-1]])
        starts = self.start + index // count * period + offsets[index % count]
        kept = (starts >= begin) & (starts <= end) & (starts < self.stopped)
        own = index[kept] % count
        return starts[kept], self.high[own], durations[own]


def ticking(rate_hz: float, begin: float, end: float, start: float = 0.0) -> Transitions:
    """Return the changes in (`begin`, `end`] of a clock that rises at `start` and has equal halves."""
    first, last = np.ceil((begin - start) * 2 * rate_hz + 1e-9), np.floor((end - start) * 2 * rate_hz + 1e-9)
    halves = np.arange(first, last + 1)
    return Transitions(start + halves / (2 * rate_hz), halves % 2 == 0)


def sampled(level: Callable[[FloatArray], BoolArray], begin: float, end: float) -> Transitions:
    """Return the changes in (`begin`, `end`] of a signal that can be asked for its level at any past time."""
    steps = np.arange(np.floor(begin / _GRID), np.floor(end / _GRID) + 1)
    if len(steps) < 2:
        return Transitions(np.zeros(0), np.zeros(0, dtype=np.bool_))
    times = steps * _GRID
    levels = level(times)
    changed = np.flatnonzero(levels[1:] != levels[:-1]) + 1
    return Transitions(times[changed], levels[changed])
