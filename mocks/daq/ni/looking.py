"""What stands at a terminal: edges of counters, clocks and digital signals, whoever makes them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ....instruments.arrays import BoolArray, FloatArray
from .pulses import PulseTrain, Transitions, sampled, ticking

if TYPE_CHECKING:
    from .channel import Channel
    from .system import NiSystem

__all__ = ["Terminals"]

_TIMEBASE = re.compile(r"(\d+)([kM])HzTimebase", re.IGNORECASE)
_PER = {"k": 1e3, "m": 1e6}
_HIGH = 0.5
"""Level above which a signal that is set reads 1, be it set in 0 and 1 or in volts."""
_MOST = 1_000_000
"""Edges of a timebase that are made at a time; more are not counted."""


class Terminals:
    """The digital signals of a system, by terminal ("/Dev1/PFI0")."""

    def __init__(self, system: NiSystem) -> None:
        self._system = system
        self._trains: dict[str, list[PulseTrain]] = {}
        self._routes: dict[str, str] = {}

    def connect(self, source: str, target: str) -> None:
        """Let `target` carry what stands at `source`."""
        self._routes[target.lower()] = source

    def disconnect(self, target: str) -> None:
        """End a route, if there is one."""
        self._routes.pop(target.lower(), None)

    def drive(self, terminal: str, train: PulseTrain) -> None:
        """Let a terminal carry a pulse train, after those that it has carried."""
        trains = self._trains.setdefault(terminal.lower(), [])
        if trains:
            trains[-1].stopped = min(trains[-1].stopped, train.start)
        # What is long over is looked at no more.
        self._trains[terminal.lower()] = [*trains[-8:], train]

    def driven(self, terminal: str) -> bool:
        """Return True when something stands at a terminal."""
        terminal = self._routes.get(terminal.lower(), terminal)
        name = terminal.lstrip("/")
        return (
            terminal.lower() in self._trains
            or name in self._system.wiring
            or _TIMEBASE.search(terminal) is not None
            or self._clock(terminal) is not None
            or (name in self._system.outputs and self._system.outputs[name].driven)
        )

    def look(self, terminal: str, begin: float, end: float) -> Transitions:
        """Return the changes at a terminal in (`begin`, `end`] (s)."""
        terminal = self._routes.get(terminal.lower(), terminal)
        found = [train.transitions(begin, end) for train in self._trains.get(terminal.lower(), ())]
        if found:
            return Transitions(
                np.concatenate([one.times for one in found]), np.concatenate([one.levels for one in found])
            )
        if (timebase := _TIMEBASE.search(terminal)) is not None:
            rate = float(timebase[1]) * _PER[timebase[2].lower()]
            return ticking(rate, max(begin, end - _MOST / rate), end)
        if (clock := self._clock(terminal)) is not None:
            rate_hz, start = clock
            return ticking(rate_hz, max(begin, start - 0.25 / rate_hz), end, start)
        name = terminal.lstrip("/")
        if name in self._system.wiring and self._system.nodes is not None:
            return sampled(self._node(name), begin, end)
        if name in self._system.outputs:
            output = self._system.outputs[name]
            return sampled(lambda times: np.asarray(output.at(times) > _HIGH), begin, end)
        return Transitions(np.zeros(0), np.zeros(0, dtype=np.bool_))

    def node(self, channel: Channel) -> Callable[[FloatArray], FloatArray] | None:
        """Return what a plant says is the count of a channel's counter at times (s), or None."""
        nodes, name = self._system.nodes, f"{channel.device.name}/{channel.physical[0]}"
        node = self._system.wiring.get(name)
        if node is None or nodes is None:
            return None
        return lambda times: np.asarray(nodes.read([node], times[np.newaxis])[0])

    def _node(self, name: str) -> Callable[[FloatArray], BoolArray]:
        node, nodes = self._system.wiring[name], self._system.nodes
        assert nodes is not None, "asked for a wired terminal only"
        return lambda times: np.asarray(nodes.read([node], times[np.newaxis])[0] > _HIGH)

    def _clock(self, terminal: str) -> tuple[float, float] | None:
        """Rate (Hz) and first edge (s) of a running task's sample clock at `terminal`, or None."""
        if not terminal.lower().endswith("/sampleclock"):
            return None
        running = (
            task for task in self._system.tasks.values() if task.channels and task.running and task.timed
        )
        for task in running:
            if task.kind != "co" and task.clock.start is not None and terminal in self._system.emits(task):
                return task.clock.rate_hz, task.clock.start
        return None
