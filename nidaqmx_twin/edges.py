"""What stands at a terminal: edges of counters, clocks and digital signals, and those that time a task.

A task waits for signals that something drives: a test, a plant, a counter or an output. As on NI's simulated
devices, a trigger that nothing drives comes at once, and a clock that nothing drives ticks at its rate.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial

import numpy as np

from ..base.arrays import BoolArray, FloatArray
from .channel import Channel
from .nodes import Nodes
from .pulses import Filter, PulseTrain, Train, Transitions, Watch, sampled, ticking
from .terminals import OutputTerminal

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
