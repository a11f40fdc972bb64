"""A rig file's plant, and the twins and wires that stand in for its instruments."""

from __future__ import annotations

from contextlib import ExitStack
from importlib import metadata
from typing import Any

from instruments.rig import Driver, Mode
from instruments.rig_file import Device, RigFile, validate
from mocks.clock import VirtualClock
from mocks.plant import Plant, Truth

__all__ = ["Simulation"]


class Simulation:
    """See `instruments.rig.Simulation`. One plant, on a virtual clock, behind every instrument.

    Twins are found by the driver's name among the entry points `haploop.twins`: each is called
    with the driver's settings and the plant. Wires, among `haploop.wires`, are called likewise and
    give a context whose value replaces settings of the real driver (its address, say). A driver
    that has neither talks to nothing (an amplifier is arithmetic), and is used as it is.
    """

    def __init__(self, file: RigFile) -> None:
        self.clock = VirtualClock()
        self._file = file
        self._stack = ExitStack()
        self.plant = Plant(file, self.clock)

    @property
    def truth(self) -> Truth:
        """See `mocks.plant.Truth`."""
        return self.plant.truth

    def instrument(self, role: str, device: Device, driver: Driver, mode: Mode) -> Any:
        """See `instruments.rig.Simulation.instrument`."""
        settings = validate(driver.Settings, device.settings, f"[{role}] of {self._file.name}")
        wires = metadata.entry_points(group="haploop.wires", name=device.driver)
        if mode == "wire" and wires:
            (wire,) = wires
            address = self._stack.enter_context(wire.load()(settings, self.plant))
            return driver.open(settings.model_copy(update=address), self.clock)
        twins = metadata.entry_points(group="haploop.twins", name=device.driver)
        if twins:
            (twin,) = twins
            return twin.load()(settings, self.plant)
        return driver.open(settings, self.clock)

    def close(self) -> None:
        """Stop every wire. May be called again."""
        self._stack.close()
