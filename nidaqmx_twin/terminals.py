"""Terminals: values and future steps of the outputs, and the edges that stand at any, whoever makes them."""

from __future__ import annotations

import re
import threading
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..base.arrays import BoolArray, FloatArray
from .channel import Channel
from .nodes import Nodes, Run
from .pulses import Filter, PulseTrain, Train, Transitions, Watch, sampled, ticking

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


# What stands at a terminal: edges of counters, clocks and digital signals, whoever makes them.

_TIMEBASE = re.compile(r"(\d+)([kM])HzTimebase", re.IGNORECASE)
_PER = {"k": 1e3, "m": 1e6}
_BUS = re.compile(r"^/[^/]+/(?=(rtsi|pxi_trig)\d+$)")
_HIGH = 0.5
"""Level above which a signal that is set reads 1, be it set in 0 and 1 or in volts."""
_MOST = 1_000_000
"""Edges of a timebase that are made at a time; more are not counted."""


class Terminals:
    """The digital signals of a system, by terminal ("/Dev1/PFI0").

    `wiring` names the node of `nodes` at a terminal.
    """

    def __init__(
        self,
        wiring: Mapping[str, str],
        nodes: Nodes | None,
        outputs: Mapping[str, OutputTerminal],
        promised: Callable[[], Collection[str]] = tuple,
        cable: bool = False,
    ) -> None:
        """`promised` are terminals that a task will drive once it runs. A `cable` joins the RTSI lines of all
        cards.
        """
        self._promised, self._cable = promised, cable
        self._wiring, self._nodes, self._outputs = wiring, nodes, outputs
        self._trains: dict[str, list[Train]] = {}
        self._routes: dict[str, str] = {}

    def _one(self, terminal: str) -> str:
        """Name by which a terminal is compared: a line of the cable is one, whatever card names it."""
        return _BUS.sub("/", terminal.lower()) if self._cable else terminal.lower()

    def irregular(self, terminal: str) -> bool:
        """Return True where a clock stands at a terminal that does not tick evenly."""
        trains = self._trains.get(terminal.lower(), [])
        return bool(trains) and not isinstance(trains[-1], PulseTrain)

    def connect(self, source: str, target: str) -> None:
        """Let `target` carry what stands at `source`."""
        self._routes[self._one(target)] = source

    def disconnect(self, target: str) -> None:
        """End a route, if there is one."""
        self._routes.pop(self._one(target), None)

    def drive(self, terminal: str, train: Train) -> None:
        """Let a terminal carry a pulse train, after those that it has carried."""
        trains = self._trains.setdefault(terminal.lower(), [])
        if trains and trains[-1] is not train:
            trains[-1].stopped = min(trains[-1].stopped, train.start)
        trains.append(train)

    def pulses(self, terminal: str, until: float) -> Transitions:
        """Return all changes that counters have put out at a terminal until a time (s)."""
        return self._put_out(terminal, -np.inf, until)

    def signalled(self, terminal: str) -> bool:
        """Return True when a test, a plant, a counter, an output or a sample clock drives a terminal."""
        terminal = self._routes.get(self._one(terminal), terminal)
        name = terminal.lstrip("/")
        return (
            terminal.lower() in self._trains
            or self._one(terminal) in map(self._one, self._promised())
            or name in self._wiring
            or (name in self._outputs and self._outputs[name].driven)
        )

    def driven(self, terminal: str) -> bool:
        """Return True when something stands at a terminal: a signal, a clock or a timebase."""
        routed = self._routes.get(self._one(terminal), terminal)
        return self.signalled(terminal) or _TIMEBASE.search(routed) is not None

    def wired(self, device: str) -> bool:
        """Return True when a test or a plant is connected to a PFI terminal of a device."""
        return any(name.lower().startswith(f"{device}/pfi".lower()) for name in self._wiring)

    def _put_out(self, terminal: str, begin: float, end: float) -> Transitions:
        found: list[Transitions] = []
        for train in reversed(self._trains.get(terminal.lower(), ())):
            found.append(train.transitions(begin, end))
            if train.start <= begin:
                break
        times = [np.zeros(0), *(one.times for one in reversed(found))]
        levels = [np.zeros(0, dtype=np.bool_), *(one.levels for one in reversed(found))]
        return Transitions(np.concatenate(times), np.concatenate(levels))

    def watched(self, terminal: str, width: float) -> Callable[[float, float], Transitions]:
        """Return what looks at a terminal from time to time, behind a digital filter unless `width` is 0."""
        look = Watch(partial(self.look, terminal)).look
        return Filter(width, look).look if width else look

    def level(self, terminal: str, when: float) -> bool:
        """Return the level at a terminal at a time (s) that has passed; low where nothing drives it."""
        terminal = self._routes.get(self._one(terminal), terminal)
        name, moment = terminal.lstrip("/"), np.array([when])
        put = self._put_out(terminal, -np.inf, when)
        if len(put.times):
            return bool(put.levels[-1])
        if name in self._wiring and self._nodes is not None:
            return bool(self._node(name)(moment)[0])
        return name in self._outputs and bool(self._outputs[name].at(moment)[0] > _HIGH)

    def look(self, terminal: str, begin: float, end: float) -> Transitions:
        """Return the changes at a terminal in (`begin`, `end`] (s)."""
        terminal = self._routes.get(self._one(terminal), terminal)
        name = terminal.lstrip("/")
        found = self._put_out(terminal, begin, end)
        if len(found.times) or (terminal.lower() in self._trains and name not in self._wiring):
            return found
        if (timebase := _TIMEBASE.search(terminal)) is not None:
            rate = float(timebase[1]) * _PER[timebase[2].lower()]
            return ticking(rate, max(begin, end - _MOST / rate), end)
        if name in self._wiring and self._nodes is not None:
            return sampled(self._node(name), begin, end)
        if name in self._outputs:
            output = self._outputs[name]
            return sampled(lambda times: np.asarray(output.at(times) > _HIGH), begin, end)
        return found

    def node(self, channel: Channel) -> Callable[[FloatArray], FloatArray] | None:
        """Return what a plant says is the count of a channel's counter at times (s), or None."""
        nodes, name = self._nodes, f"{channel.device.name}/{channel.physical[0]}"
        node = self._wiring.get(name)
        if node is None or nodes is None:
            return None
        return lambda times: np.asarray(nodes.read([node], times[np.newaxis])[0])

    def _node(self, name: str) -> Callable[[FloatArray], BoolArray]:
        node, nodes = self._wiring[name], self._nodes
        assert nodes is not None, "asked for a wired terminal only"
        return lambda times: np.asarray(nodes.read([node], times[np.newaxis])[0] > _HIGH)


_PULSE = 50e-9
"""Width of a change detection event (s; estimate)."""


class Edges:
    """The edges at terminals since `began` (s): `watched` names each terminal and its edge, True for rising.

    Edges of several terminals at one moment count once. A digital filter of `width` (s) may be in their way.
    """

    def __init__(
        self, terminals: Terminals, watched: Iterable[tuple[str, bool]], began: float, width: float = 0.0
    ) -> None:
        self.terminals = terminals
        self._watched = [(terminals.watched(name, width), rising) for name, rising in dict.fromkeys(watched)]
        self._seen = self.start = began
        self.stopped = np.inf
        self.times = np.zeros(0)
        """Times of the edges (edges,) s, rising, as far as was looked."""

    def count(self, now: float) -> int:
        """Look until `now` (s), and return the number of edges."""
        if now >= self._seen:
            found = [look(self._seen, now).to(rising) for look, rising in self._watched]
            self.times = np.concatenate([self.times, np.unique(np.concatenate(found))])
            self._seen = now
        return len(self.times)

    def transitions(self, begin: float, end: float) -> Transitions:
        """Return the changes in (`begin`, `end`] of a line that has a pulse at each edge."""
        self.count(min(end, self.stopped))
        times = np.column_stack([self.times, self.times + _PULSE]).ravel()
        kept = (times > begin) & (times <= end) & (times < self.stopped)
        return Transitions(times[kept], np.tile([True, False], len(self.times))[kept])


class Bursts(Edges):
    """The sample clock of a task that each trigger starts again: `samples` edges at `rate_hz` after each.

    A trigger during such a burst is ignored (X Series manual 370784, "Retriggerable Analog Input").
    """

    def __init__(self, triggers: Edges, samples: int, rate_hz: float, delay: float) -> None:
        super().__init__(triggers.terminals, (), triggers.start)
        self._triggers, self._looked = triggers, 0
        self._burst = delay + np.arange(samples) / rate_hz

    def count(self, now: float) -> int:
        """See `Edges`."""
        self._triggers.count(now)
        for when in self._triggers.times[self._looked :]:
            if not len(self.times) or when >= self.times[-1]:
                self.times = np.concatenate([self.times, when + self._burst])
        self._looked = len(self._triggers.times)
        return int(np.searchsorted(self.times, now + 1e-12, side="right"))
