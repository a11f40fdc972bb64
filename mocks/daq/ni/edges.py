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

    Edges of several terminals at one moment count once.
    """

    def __init__(self, terminals: Terminals, watched: Iterable[tuple[str, bool]], began: float) -> None:
        self._terminals, self._watched = terminals, tuple(dict.fromkeys(watched))
        self._seen = self.start = began
        self.stopped = np.inf
        self.times = np.zeros(0)
        """Times of the edges (edges,) s, rising, as far as was looked."""

    def count(self, now: float) -> int:
        """Look until `now` (s), and return the number of edges."""
        if now > self._seen:
            found = [self._terminals.look(name, self._seen, now).to(rising) for name, rising in self._watched]
            self.times = np.concatenate([self.times, np.unique(np.concatenate(found))])
            self._seen = now
        return len(self.times)

    def transitions(self, begin: float, end: float) -> Transitions:
        """Return the changes in (`begin`, `end`] of a line that has a pulse at each edge."""
        self.count(min(end, self.stopped))
        times = np.column_stack([self.times, self.times + _PULSE]).ravel()
        kept = (times > begin) & (times <= end) & (times < self.stopped)
        return Transitions(times[kept], np.tile([True, False], len(self.times))[kept])
