"""A plant that is nothing but contacts, for tests of relay boxes."""

from collections.abc import Iterable

import numpy as np

from haploop.base.clock import VirtualClock
from haploop.mocks.plant import Faults, Switches


class Contacts:
    def __init__(self, patches: Iterable[str]) -> None:
        self.clock = VirtualClock()
        self.faults = Faults()
        self.events: list[tuple[float, str, bool]] = []
        self._patches = tuple(patches)
        self._boxes: list[Switches] = []

    def rng(self, name: str) -> np.random.Generator:
        return np.random.default_rng(7)

    def wire(self, box: Switches) -> None:
        self._boxes.append(box)

    def closed(self) -> set[str]:
        """Which contacts are closed now."""
        for box in self._boxes:
            self.events += [(at, patch, closed) for patch, closed, at in box.take(self.clock.now())]
        done = sorted(e for e in self.events if e[0] <= self.clock.now())
        return {p for p in self._patches if [c for _, q, c in done if q == p][-1:] == [True]}
