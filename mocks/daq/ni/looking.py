"""What stands at a terminal: edges of counters, clocks and digital signals, whoever makes them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import numpy as np

from ....base.arrays import BoolArray, FloatArray
from ...nodes import Nodes
from .channel import Channel
from .pulses import Train, Transitions, sampled, ticking
from .terminals import OutputTerminal

_TIMEBASE = re.compile(r"(\d+)([kM])HzTimebase", re.IGNORECASE)
_PER = {"k": 1e3, "m": 1e6}
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
    ) -> None:
        self._wiring, self._nodes, self._outputs = wiring, nodes, outputs
        self._trains: dict[str, list[Train]] = {}
        self._routes: dict[str, str] = {}

    def connect(self, source: str, target: str) -> None:
        """Let `target` carry what stands at `source`."""
        self._routes[target.lower()] = source

    def disconnect(self, target: str) -> None:
        """End a route, if there is one."""
        self._routes.pop(target.lower(), None)

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
        terminal = self._routes.get(terminal.lower(), terminal)
        name = terminal.lstrip("/")
        return (
            terminal.lower() in self._trains
            or name in self._wiring
            or (name in self._outputs and self._outputs[name].driven)
        )

    def driven(self, terminal: str) -> bool:
        """Return True when something stands at a terminal: a signal, a clock or a timebase."""
        return self.signalled(terminal) or _TIMEBASE.search(terminal) is not None

    def _put_out(self, terminal: str, begin: float, end: float) -> Transitions:
        found: list[Transitions] = []
        for train in reversed(self._trains.get(terminal.lower(), ())):
            found.append(train.transitions(begin, end))
            if train.start <= begin:
                break
        times = [np.zeros(0), *(one.times for one in reversed(found))]
        levels = [np.zeros(0, dtype=np.bool_), *(one.levels for one in reversed(found))]
        return Transitions(np.concatenate(times), np.concatenate(levels))

    def look(self, terminal: str, begin: float, end: float) -> Transitions:
        """Return the changes at a terminal in (`begin`, `end`] (s)."""
        terminal = self._routes.get(terminal.lower(), terminal)
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
