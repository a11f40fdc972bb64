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

from ..base.arrays import BoolArray, FloatArray

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


class Triggers(Protocol):
    """Edges of a trigger: `count` looks until a time (s)."""

    times: FloatArray

    def count(self, now: float) -> int:
        """Return the number of edges until `now` (s)."""


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


@dataclass(eq=False)
class TriggeredTrain(PulseTrain):
    """Pulses that each trigger begins anew; one that comes before the last of them is over is ignored.

    (Inferred from inputs: X Series manual 370784, "Retriggerable Analog Input".)
    """

    triggers: Triggers | None = None
    delays: tuple[float, float] = (0.0, 0.0)
    """From the first trigger to its pulses, and from each other one (s)."""

    @property
    def end(self) -> float:
        """Time when it is stopped: another trigger may always come."""
        return self.stopped

    def _each(self, now: float) -> list[PulseTrain]:
        assert self.triggers is not None, "made with triggers"
        trains: list[PulseTrain] = []
        self.triggers.count(now)
        for when in self.triggers.times:
            if not trains or when >= trains[-1].end - 1e-9:
                start = float(when) + self.delays[bool(trains)]
                trains.append(PulseTrain(start, self.high, self.low, self.total, self.idle, self.stopped))
        return trains

    def begun(self, now: float) -> int:
        """Number of pulses that have begun by `now`."""
        return sum(train.begun(now) for train in self._each(now))

    def transitions(self, begin: float, end: float) -> Transitions:
        """Return the changes in (`begin`, `end`]."""
        found = [train.transitions(begin, end) for train in self._each(end)]
        times = np.concatenate([np.zeros(0), *(one.times for one in found)])
        return Transitions(times, np.concatenate([np.zeros(0, np.bool_), *(one.levels for one in found)]))


class Watch:
    """Looks at a signal from time to time, and gives each change once.

    What a program starts at the very moment of a look is later on a card: it is given by the next one.
    """

    def __init__(self, look: Callable[[float, float], Transitions]) -> None:
        self._look, self._last = look, -np.inf

    def look(self, begin: float, end: float) -> Transitions:
        """Return the changes from `begin` to `end` that were not given yet."""
        found = self._look(float(np.nextafter(begin, -np.inf)), end)
        new = (found.times >= begin) & (found.times > self._last)
        self._last = max(self._last, *found.times[new]) if new.any() else self._last
        return Transitions(found.times[new], found.levels[new])


class Filter:
    """Lets a change of a signal pass that lasts for `width` (s), by as much later. It is asked in order.

    (X Series manual 370784, M Series manual 371022, "PFI Filters": a filter sees it N times in a row.)
    """

    def __init__(self, width: float, look: Callable[[float, float], Transitions]) -> None:
        self._width, self._look = width, look
        self._open = Transitions(np.zeros(0), np.zeros(0, dtype=np.bool_))
        self._level: bool | None = None

    def look(self, begin: float, end: float) -> Transitions:
        """Return the changes in (`begin`, `end`] that have passed."""
        found = self._look(begin, end)
        times = np.concatenate([self._open.times, found.times])
        levels = np.concatenate([self._open.levels, found.levels])
        lasts = np.minimum(np.append(times[1:], np.inf), end)[: len(times)] - times >= self._width * (
            1 - 1e-9
        )
        still = slice(len(times) - 1, None) if len(times) and not lasts[-1] else slice(0, 0)
        self._open = Transitions(times[still], levels[still])
        if self._level is None and len(levels):
            self._level = not levels[0]
        before = np.append([bool(self._level)], levels[lasts])[:-1]
        kept = levels[lasts] != before
        if lasts.any():
            self._level = bool(levels[lasts][-1])
        return Transitions(times[lasts][kept] + self._width, levels[lasts][kept])


def ticking(rate_hz: float, begin: float, end: float, start: float = 0.0) -> Transitions:
    """Return the changes in (`begin`, `end`] of a clock that rises at `start` and has equal halves."""
    first, last = np.ceil((begin - start) * 2 * rate_hz + 1e-9), np.floor((end - start) * 2 * rate_hz + 1e-9)
    halves = np.arange(first, last + 1)
    return Transitions(start + halves / (2 * rate_hz), halves % 2 == 0)


def sampled(level: Callable[[FloatArray], BoolArray], begin: float, end: float) -> Transitions:
    """Return the changes in (`begin`, `end`] of a signal that can be asked for its level at any past time."""
    # What lies within rounding of the grid is on it, so that intervals that meet miss nothing.
    steps = np.arange(np.floor(begin / _GRID + 1e-6), np.floor(end / _GRID + 1e-6) + 1)
    if len(steps) < 2:
        return Transitions(np.zeros(0), np.zeros(0, dtype=np.bool_))
    times = steps * _GRID
    levels = level(times)
    changed = np.flatnonzero(levels[1:] != levels[:-1]) + 1
    return Transitions(times[changed], levels[changed])
