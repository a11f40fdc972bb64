"""A rig file's plant, and the twins and wires that stand in for its instruments."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

from ..base import entry_points
from ..base.clock import Clock, RealTimeClock, VirtualClock
from ..base.errors import ConfigurationError
from ..instruments.config import Device, RigFile
from ..instruments.driver import Driver, Mode, is_arithmetic, settings_of
from .plant import KINDS, Fault, Faults, OnLine, Plant, PlantSource, Truth
from .transport import ReplyFault, faulty_line


class Simulation:
    """See `haploop.instruments.rig.rig.Simulation`. One plant, on a virtual clock, behind every instrument.

    Twins are found by the driver's name among the entry points `haploop.twins`; each is called
    with the driver's settings and the plant. Wires, among `haploop.wires`, are called with the same
    arguments and return a context manager whose value replaces settings of the real driver, such as
    its address. A driver with neither is refused, unless it says that it is arithmetic: it would open what
    is really there.
    """

    fault_kinds = KINDS
    """See `haploop.mocks.plant.FaultKinds`."""

    @staticmethod
    def own_faults() -> Mapping[str, type[Fault]]:
        """Return haploop's own kinds of fault, by their names in rig files."""
        from .faults import OWN  # noqa: PLC0415  some 30 ms, for which a rig without faults does not wait

        return OWN

    def __init__(
        self, file: RigFile, clock: Clock | None = None, plant: object = None, real_time: bool = False
    ) -> None:
        """`plant` replaces the plant that the file names; `real_time` is for a clock that is not given.

        Raises ConfigurationError for a plant that is another object.
        """
        if plant is not None and not isinstance(plant, PlantSource):
            raise ConfigurationError(
                f"The plant that was given is an object of {type(plant).__name__}: give an instance of a "
                "subclass of haploop.mocks.plant.PlantSource (docs/how-to/adding-a-plant.md)."
            )
        self.clock = clock or (RealTimeClock() if real_time else VirtualClock())
        self._file = file
        self._stack = ExitStack()
        self.plant = Plant(file, self.clock, plant)

    @property
    def truth(self) -> Truth:
        """See `haploop.mocks.plant.Truth`."""
        return self.plant.truth

    @property
    def faults(self) -> Faults:
        """The rig file's faults; each counts how often it has fired."""
        return self.plant.faults

    def instrument(self, role: str, device: Device, driver: Driver, mode: Mode) -> Any:
        """See `haploop.instruments.rig.rig.Simulation.instrument`."""
        settings = settings_of(driver, device, role, self._file.name)
        wires = device.driver in entry_points.installed(entry_points.WIRES)
        disturbed = [fault for fault in self.faults.at(OnLine) if fault.line == role]
        if disturbed and (mode == "twin" or not wires):
            raise ConfigurationError(
                f"A fault of the kind {disturbed[0].kind!r} needs a line to the {role}, and {device.driver} "
                f"has none when it is simulated as {mode}: simulate as wire, with a driver that talks to "
                "hardware."
            )
        if mode == "wire" and wires:
            address = self.serve(device.driver, settings)
            if not address:
                raise ConfigurationError(
                    f"The wire of {device.driver!r} replaces no setting of its driver, which would open the "
                    "real instrument: ask the author of the wire."
                )
            if disturbed:

                def disturbance(request: str) -> ReplyFault | None:
                    now = self.clock.now()
                    answers = (fault.answer(request, now) for fault in disturbed)
                    return next((answer for answer in answers if answer), None)

                address = self._stack.enter_context(faulty_line(address, disturbance))
            return driver.open(settings.model_copy(update=address), self.clock)
        if device.driver in entry_points.installed(entry_points.TWINS):
            return entry_points.load(entry_points.TWINS, device.driver)(settings, self.plant)
        if not is_arithmetic(driver):
            remedy = "simulate as wire" if wires else f"install or write a twin of {device.driver!r}"
            raise ConfigurationError(
                f"The {role} of {self._file.name!r} cannot be simulated: its driver {device.driver!r} has no "
                f"{mode}, and would open the real instrument. Leave it out of the rig file, or {remedy} "
                "(docs/how-to/adding-an-instrument.md)."
            )
        return driver.open(settings, self.clock)

    def serve(self, driver: str, settings: Any) -> dict[str, Any]:
        """Serve a driver's wire until `close`; return the settings that point the driver at it."""
        wire = entry_points.load(entry_points.WIRES, driver)
        address: dict[str, Any] = self._stack.enter_context(wire(settings, self.plant))
        return address

    def close(self) -> None:
        """Stop every wire. May be called again."""
        self._stack.close()
