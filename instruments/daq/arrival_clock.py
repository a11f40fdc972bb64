"""When the n-th sample of a source was taken, from when samples arrived.

A source takes a sample every T of its own clock, and the sample n arrives at a_n = s + n T + d_n of ours,
where the delay d_n >= d of buffers, USB and the scheduler varies and is never less than the shortest. So the
line below all (n, a_n) that touches the earliest arrivals, an edge of their lower convex hull, is s + d + n
T: its slope is the source's period on our clock, however wrong its nominal rate is (Moon, Skelly and Towsley,
INFOCOM 1999, for packets of a network). What no arrival tells is d itself: the shortest delay is declared, or
measured by an edge that both sources see. What breaks it: samples that are lost without a trace, which shift
n.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np

from ...base.arrays import FloatArray

_BUCKET = 0.5
"""Interval of whose arrivals the earliest is kept (s)."""
_KEPT = 240
"""Intervals that are kept: two minutes, in which a crystal moves by less than a millisecond."""
_SURE = 5.0
"""Time (s) over which they must reach before a slip is told from their noise."""
_STEADY = 5e-3
"""Lateness (s) that is none."""
_SPAN = 1.0
"""Time (s) over which arrivals must reach before the source's rate is taken from them."""


class ArrivalClock:
    """Times of a source's samples on our clock; `rate_hz` is its nominal rate."""

    def __init__(self, rate_hz: float) -> None:
        self._nominal = 1 / rate_hz
        self._points: deque[tuple[int, float, float]] = deque(maxlen=_KEPT)
        """Of each interval: the sample whose arrival was earliest, how late it was by the nominal rate, and
        when the interval began."""
        self.slip = 0.0
        """By how much the earliest arrival of the last interval was later than those before let expect (s):
        samples were lost without a trace. 0 while too little is known, and once it was read."""
        self._line: tuple[float, float] | None = None
        self._late: deque[float] = deque(maxlen=2000)

    @property
    def ready(self) -> bool:
        """True once arrivals tell the rate."""
        return len(self._points) > 1 and self._reach >= _SPAN

    @property
    def rate_hz(self) -> float:
        """The source's rate on our clock (Hz): the nominal one until arrivals tell it."""
        return 1 / (self._nominal + self._fit()[1])

    @property
    def jitter(self) -> float:
        """How much later than the earliest 95 % of the arrivals are at most (s)."""
        if not self._late:
            return 0.0
        return max(0.0, float(np.quantile(self._late, 0.95) - min(self._late)))

    @property
    def _reach(self) -> float:
        return (self._points[-1][0] - self._points[0][0]) * self._nominal if self._points else 0.0

    def note(self, index: int, time: float) -> None:
        """Note that the sample `index` arrived at `time` (s)."""
        excess = time - index * self._nominal
        if self._points and time - self._points[-1][2] < _BUCKET:
            last = self._points[-1]
            if excess < last[1]:
                self._points[-1] = (index, excess, last[2])
                self._line = None
        else:
            self._close_interval()
            self._points.append((index, excess, time))
            self._line = None
        self._late.append(time - float(self.at(np.array([index]))[0]))

    def _close_interval(self) -> None:
        """Compare the interval that has ended with those before."""
        if self._reach < _SURE:
            return
        index, excess, _ = last = self._points.pop()
        self._line = None
        begin, slope = self._fit()
        self._points.append(last)
        late = excess - begin - slope * index
        self.slip = late if late > _STEADY + 3 * self.jitter else 0.0

    def at(self, indices: FloatArray) -> FloatArray:
        """When samples arrived that were delayed least, (samples,) s."""
        begin, slope = self._fit()
        return np.asarray(begin + indices * (self._nominal + slope))

    def _fit(self) -> tuple[float, float]:
        """Begin (s) and slope (s per sample, above the nominal period) of the line below all arrivals."""
        if self._line is None:
            self._line = self._fitted()
        return self._line

    def _fitted(self) -> tuple[float, float]:
        if not self._points:
            return 0.0, 0.0
        points = [(float(index), excess) for index, excess, _ in self._points]
        if not self.ready:
            return min(excess for _, excess in points), 0.0
        hull: list[tuple[float, float]] = []
        for x, y in points:
            while len(hull) > 1 and _turns_down(hull[-2], hull[-1], (x, y)):
                hull.pop()
            hull.append((x, y))
        middle = (points[0][0] + points[-1][0]) / 2
        # Of the edges below all points, the one over the middle is nearest to all of them.
        (x, y), (x2, y2) = next(
            ((a, b) for a, b in pairwise(hull) if a[0] <= middle <= b[0]),
            (hull[0], hull[-1]),
        )
        slope = (y2 - y) / (x2 - x) if x2 > x else 0.0
        return y - slope * x, slope


def _turns_down(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """True when b lies on or above the line from a to c."""
    return (b[0] - a[0]) * (c[1] - a[1]) <= (c[0] - a[0]) * (b[1] - a[1])
