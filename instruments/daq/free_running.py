"""A DAQ on a clock of its own, recorded along with the rig's DAQ, and when its samples were taken.

Both are one Daq to the rig. The rows of the free-running one are placed on the other's samples: each of its
samples gets a time from when samples arrived (`arrival_clock.py`), and so does each block of the DAQ; in
between the rows go straight from one sample to the next. `FreeRunning.uncertainty` says how well that time is
known.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError
from .role import Block, Daq, Stream, StreamRequest

_LATE = 2.0
"""Time (s) by which a free-running DAQ may be behind the other one."""
_STEP = 0.005
"""Interval at which it is looked for then (s)."""
_NEAR = 0.25
"""Largest distance (s) of one edge on the two DAQs."""


class FreeRunning(Daq):
    """See `Daq`, and this module. Its safe state is none: it puts nothing out."""

    channels: Mapping[str, float]
    """Its channels, each with its range (+- V)."""
    edge: Edge | None
    """An edge that the DAQ sees too, if one is wired to both."""

    @property
    @abstractmethod
    def uncertainty(self) -> float:
        """How far off its samples' times may be (s)."""

    @abstractmethod
    def settle(self) -> None:
        """Wait until arrivals tell its rate, so that samples from now on can be placed. Raises
        InstrumentError.
        """

    @abstractmethod
    def follow(self, wait: float) -> float:
        """Take what has arrived, after at most `wait` s of real time; return the latest sample's time (s).

        Raises InstrumentError.
        """

    @abstractmethod
    def at(self, channels: Sequence[str], times: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return (channels, times) V at times (s) that `follow` has passed, and (channels,) overload.

        What lies before is forgotten. Raises InstrumentError where too many samples in a row were lost.
        """

    @abstractmethod
    def edges(self) -> list[float]:
        """Times (s) of rising edges of `edge` since the last call."""

    @abstractmethod
    def correct(self, late: Sequence[float]) -> None:
        """Take note by how much (s) its edges were placed after those of the DAQ, in one stream."""


@dataclass(frozen=True)
class Edge:
    """A rising edge that the DAQ sees on `channel` at `threshold` (V), and the free-running one too."""

    channel: str
    threshold: float


class CombinedDaq(Daq):
    """A DAQ with a free-running one beside it: see this module. Plays and outputs are the DAQ's alone."""

    def __init__(self, daq: Daq, along: FreeRunning, clock: Clock, base: str | None = None) -> None:
        """`base` is a channel of the DAQ to be read where none is asked for, for its clock."""
        self._daq, self._along = daq, along
        self.clock, self._base = clock, base
        self._interlock = daq._interlock
        self.identity = f"{daq.identity}, and along with it {along.identity}"
        self.simulated = daq.simulated or along.simulated
        self.declared = daq.declared

    def _stream(self, request: StreamRequest) -> Stream:
        channels = request.channels
        own = [name for name in channels if name not in self._along.channels]
        if len(own) == len(channels):
            return self._daq._stream(request)
        edge = self._along.edge
        # Of these the free-running one has need, whether they are asked for or not.
        needed = [edge.channel] if edge is not None else [self._base] if not own and self._base else []
        read = tuple(dict.fromkeys([*own, *needed]))
        if not read:
            raise ConfigurationError(
                f"{', '.join(channels)} of {self._along.identity} cannot be read without a channel of the "
                "DAQ, on whose clock they are placed: add one."
            )
        self._along.settle()
        return _AlongsideStream(self, channels, self._daq._stream(replace(request, channels=read)))

    def cards(self, channels: Sequence[str]) -> Mapping[str, Sequence[str]]:
        """See `Daq.cards`: the free-running one's are with the DAQ's first card, on whose clock they are
        placed.
        """
        groups = {
            card: list(names)
            for card, names in self._daq.cards([c for c in channels if c not in self._along.channels]).items()
        }
        for name in channels:
            if name in self._along.channels:
                groups.setdefault(next(iter(groups), ""), []).append(name)
        return groups

    def response(self, channel: str, frequencies: FloatArray) -> ComplexArray:
        """See `Daq.response`."""
        return (self._along if channel in self._along.channels else self._daq).response(channel, frequencies)

    def filtered(self, channel: str) -> bool:
        """See `Daq.filtered`."""
        return (self._along if channel in self._along.channels else self._daq).filtered(channel)

    def output_response(self, output: str, frequencies: FloatArray) -> ComplexArray:
        """See `Daq.output_response`."""
        return self._daq.output_response(output, frequencies)

    def clear_left(self) -> None:
        """See `Daq.clear_left`."""
        self._daq.clear_left()

    def zero(self) -> None:
        """See `Daq.zero`."""
        self._daq.zero()

    def hold(self) -> None:
        """See `Daq.hold`."""
        self._daq.hold()

    def _let_go(self) -> None:
        self._daq._let_go()

    def outputs_read(self) -> Mapping[str, float]:
        """See `Daq.outputs_read`."""
        return self._daq.outputs_read()

    def close(self) -> None:
        """See `Daq.close`: each is closed by the rig itself."""
        self._daq.close()


class _AlongsideStream(Stream):
    """See `Stream`. A block is given out once the free-running DAQ has passed its end."""

    def __init__(self, daq: CombinedDaq, channels: tuple[str, ...], stream: Stream) -> None:
        along = daq._along
        self.channels, self.rate_hz = channels, stream.rate_hz
        self._daq, self._stream = daq, stream
        self._own = [row for row, name in enumerate(channels) if name not in along.channels]
        self._others = [row for row, name in enumerate(channels) if name in along.channels]
        self._read = [stream.channels.index(channels[row]) for row in self._own]
        self.delays, self.full_scale = np.zeros(len(channels)), np.zeros(len(channels))
        self.delays[self._own] = stream.delays[self._read]
        self.full_scale[self._own] = stream.full_scale[self._read]
        self.full_scale[self._others] = [along.channels[channels[row]] for row in self._others]
        self._times = ArrivalClock(stream.rate_hz)
        self._edges: list[float] = []
        self._theirs: list[float] = []
        self._before = np.inf
        self._open = True

    def __iter__(self) -> Iterator[Block]:
        """See `Stream.__iter__`."""
        waiting: deque[Block] = deque()
        along, clock = self._daq._along, self._daq.clock
        for block in self._stream:
            self._times.note(block.end - 1, clock.now())
            self._note_edges(block)
            waiting.append(block)
            until = along.follow(0.0)
            while waiting and self._end(waiting[0]) <= until:
                yield self._placed(waiting.popleft())
            if waiting and self._end(waiting[0]) < clock.now() - _LATE:
                raise self._behind()
        began = clock.now()
        while waiting and self._open:
            if self._end(waiting[0]) <= along.follow(_STEP):
                yield self._placed(waiting.popleft())
            elif clock.now() - began > _LATE:
                raise self._behind()
            else:
                clock.sleep(_STEP)

    def close(self) -> None:
        """See `Stream.close`."""
        if self._open:
            self._open = False
            self._stream.close()
            self._daq._along.correct(self._lateness())

    def _end(self, block: Block) -> float:
        return float(self._times.at(np.array([block.end - 1.0]))[0])

    def _behind(self) -> InstrumentError:
        return InstrumentError(
            f"{self._daq._along.identity} has sent nothing for {_LATE:g} s: check its cable and its program."
        )

    def _placed(self, block: Block) -> Block:
        along = self._daq._along
        times = self._times.at(np.arange(block.first, block.end, dtype=np.float64))
        names = [self.channels[row] for row in self._others]
        volts = np.empty((len(self.channels), len(times)))
        overload = np.zeros(len(self.channels), dtype=np.bool_)
        volts[self._own], overload[self._own] = block.volts[self._read], block.overload[self._read]
        volts[self._others], overload[self._others] = along.at(names, times)
        self._theirs += along.edges()
        return Block(block.first, volts, overload)

    def _note_edges(self, block: Block) -> None:
        edge = self._daq._along.edge
        if edge is None:
            return
        row = block.volts[self._stream.channels.index(edge.channel)]
        high = np.concatenate([[self._before], row]) > edge.threshold
        rises = np.flatnonzero(high[1:] & ~high[:-1])
        self._before = float(row[-1])
        self._edges += self._times.at(block.first + rises.astype(np.float64)).tolist()

    def _lateness(self) -> list[float]:
        """By how much the free-running one's edges came after the nearest of the DAQ's."""
        if not self._edges:
            return []
        mine = np.array(self._edges)
        late = [theirs - mine[np.abs(mine - theirs).argmin()] for theirs in self._theirs]
        return [float(one) for one in late if abs(one) < _NEAR]


# When the n-th sample of a source was taken, from when samples arrived.
#
# A source takes a sample every T of its own clock, and the sample n arrives at a_n = s + n T + d_n of ours,
# where the delay d_n >= d of buffers, USB and the scheduler varies and is never less than the shortest. So
# the line below all (n, a_n) that touches the earliest arrivals, an edge of their lower convex hull, is s + d
# + n T: its slope is the source's period on our clock, however wrong its nominal rate is (Moon, Skelly and
# Towsley, INFOCOM 1999, for packets of a network). What no arrival tells is d itself: the shortest delay is
# declared, or measured by an edge that both sources see. What breaks it: samples that are lost without a
# trace, which shift n.

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
            ((a, b) for a, b in pairwise(hull) if a[0] <= middle <= b[0]), (hull[0], hull[-1])
        )
        slope = (y2 - y) / (x2 - x) if x2 > x else 0.0
        return y - slope * x, slope


def _turns_down(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """True when b lies on or above the line from a to c."""
    return (b[0] - a[0]) * (c[1] - a[1]) <= (c[0] - a[0]) * (b[1] - a[1])
