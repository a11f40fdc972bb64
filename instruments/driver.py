"""Protocols behind the entry points: a driver, and the simulation that replaces drivers."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import Any, Protocol

from pydantic import BaseModel

from ..base.clock import Clock
from ..base.validation import validate
from .config import Device

Mode = str
"""How a rig is simulated: "twin", "wire", or "tape:FILE"."""
TAPE = "tape:"
"""Beginning of a mode that plays a tape."""


class Driver(Protocol):
    """Object named by an entry point of the group `haploop.drivers`: usually a role's subclass."""

    Settings: type[BaseModel]
    """Validates the instrument's table of the rig file."""

    def open(self, settings: Any, clock: Clock) -> Any:
        """Connect, change no output, and return an implementation of the role."""

    # Optional:
    # arithmetic: bool = True
    #     It talks to no hardware: a simulated rig uses it as it is. Any other driver needs a twin or a wire
    #     to be simulated.
    # def hardware(self, settings: Any) -> Collection[str]
    #     Names of the hardware that no other program may use meanwhile: a card, a port. It may ask the
    #     instrument for its serial number. Without it, two rigs with this driver exclude each other.
    # taped = True
    #     Every call to the device passes through `haploop.instruments.tape.taped_line()`. Without it the
    #     instrument is on no tape, and a tape is not played to it.
    # What is opened then has `pieces`, the same names as it knows itself: a rig is not opened when they are
    # others. Without them `hardware` is asked again.


def settings_of(driver: Driver, device: Device, role: str, rig: str) -> Any:
    """A role's table of a rig file as the driver's settings. Raises ConfigurationError."""
    return validate(driver.Settings, device.settings, f"[{role}] of {rig}")


def one_name(address: str) -> str:
    """Canonical name of a port, host or resource, however it was written."""
    if address.startswith("/"):
        return os.path.realpath(address)
    return address.lower().replace("localhost", "127.0.0.1")


def is_arithmetic(driver: Driver) -> bool:
    """True when a driver says that it talks to no hardware."""
    return getattr(driver, "arithmetic", False) is True


def hardware_of(name: str, driver: Driver, settings: Any) -> frozenset[str]:
    """Names of the pieces of hardware that a driver would use with these settings."""
    if is_arithmetic(driver):
        return frozenset()
    named: Collection[str] = getattr(driver, "hardware", lambda _settings: (name,))(settings)
    return frozenset(named)


class Simulation(Protocol):
    """Object made by the entry point `haploop.simulation`: the plant with its simulated instruments."""

    clock: Clock
    truth: Any
    """Ground truth of the simulation, for tests and reports: no estimator may read it."""

    def instrument(self, role: str, device: Device, driver: Driver, mode: Mode) -> Any:
        """Return the role's twin, or in mode "wire" the real driver connected to its wire."""

    def close(self) -> None:
        """Stop every wire."""
