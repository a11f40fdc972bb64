"""Interim relay twin by the lead until mocks/relay.py exists."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from instruments.relay import Relay


class RelayTwin(Relay):
    """Interim."""

    def __init__(self, settings: Any, plant: Any) -> None:
        self.identity = "relay twin"
        self.patches = tuple(settings.patches)
        self.rating = settings.rating
        self.dead_man = settings.dead_man
        self._plant = plant
        self._closed: frozenset[str] = frozenset()

    def connect(self, patches: Collection[str]) -> None:
        now = self._plant.clock.now()
        for p in self.patches:
            self._plant.switch(p, p in patches, now + 0.005)
        self._closed = frozenset(patches)
        self._plant.clock.sleep(0.02)

    def connected(self) -> frozenset[str]:
        return self._closed

    def renew(self) -> None:
        pass

    def close(self) -> None:
        pass
