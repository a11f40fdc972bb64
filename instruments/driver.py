"""What a driver is, and what stands in for one: the protocols behind the entry points."""

from __future__ import annotations

from typing import Any, Literal, Protocol

from pydantic import BaseModel

from instruments.clock import Clock
from instruments.rig_file import Device

__all__ = ["Driver", "Mode", "Simulation"]

Mode = Literal["twin", "wire"]


class Driver(Protocol):
    """What an entry point of the group `haploop.drivers` names: usually a role's subclass."""

    Settings: type[BaseModel]
    """Validates the instrument's table of the rig file."""

    def open(self, settings: Any, clock: Clock) -> Any:
        """Connect, change no output, and return an implementation of the role."""


class Simulation(Protocol):
    """What the entry point `haploop.simulation` makes: the plant that stands in for the world."""

    clock: Clock
    truth: Any
    """What only a simulator can know. For tests and reports: no estimator may read it."""

    def instrument(self, role: str, device: Device, driver: Driver, mode: Mode) -> Any:
        """The role's twin, or in mode "wire" the real driver pointed at its wire."""

    def close(self) -> None:
        """Stop every wire."""
