"""Edges of digital signals that time a task: change detection, a clock or a start trigger from outside.

A task waits for signals that something drives: a test, a plant, a counter or an output. As on NI's simulated
devices, a trigger that nothing drives comes at once, and a clock that nothing drives ticks at its rate.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .looking import Terminals
from .pulses import Transitions

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
