"""A plant that is nothing but contacts, for tests of relay boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from mocks.clock import VirtualClock
from mocks.relay import BoxFault


class Contacts:
    def __init__(self, patches: Iterable[str]) -> None:
        self.clock = VirtualClock()
        self.events: list[tuple[float, str, bool]] = []
        self._patches = tuple(patches)
        self._callbacks: list[Callable[[float], None]] = []

    def rng(self, name: str) -> np.random.Generator:
        return np.random.default_rng(7)

    def every(self, callback: Callable[[float], None]) -> None:
        self._callbacks.append(callback)

    def box_faults(self, patches: Mapping[str, int]) -> list[BoxFault]:
        return []

    def switch(self, patch: str, closed: bool, at: float) -> None:
        self.events.append((at, patch, closed))

    def closed(self) -> set[str]:
        """Which contacts are closed now."""
        for callback in self._callbacks:
            callback(self.clock.now())
        done = sorted(e for e in self.events if e[0] <= self.clock.now())
        return {p for p in self._patches if [c for _, q, c in done if q == p][-1:] == [True]}
