"""Calls that give a physical channel the memory of a sensor (TEDS), and those that would write into one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .errors import DaqmxError, DAQmxErrors
from .reading import Alive, Call
from .system import NiSystem
from .teds import BASIC, not_detected, teds_from_file


def _configure(system: NiSystem, request: Any, alive: Alive) -> None:
    for device, tail in system.inventory.resolve(request.physical_channel):
        if not request.file_path:
            raise not_detected(f"{device.name}/{tail}")
        system.teds[f"{device.name}/{tail}"] = teds_from_file(Path(request.file_path))


def _clear(system: NiSystem, request: Any, alive: Alive) -> None:
    for device, tail in system.inventory.resolve(request.physical_channel):
        system.teds.pop(f"{device.name}/{tail}", None)


def _write(of: str) -> Call:
    """Make a call that writes into a sensor's memory: there is none here that can be written to."""

    def call(system: NiSystem, request: Any, alive: Alive) -> None:
        ((device, tail), *_) = system.inventory.resolve(request.physical_channel)
        given = getattr(request, of)
        if of == "file_path" and given:
            teds_from_file(Path(given))
        elif len(given) * 8 < BASIC:
            raise DaqmxError(
                DAQmxErrors.TEDS_SENSOR_DATA_ERROR, "TEDS sensor data are not valid: too few bits."
            )
        raise not_detected(f"{device.name}/{tail}")

    return call


TEDS: dict[str, Call] = {
    "ConfigureTEDS": _configure,
    "ClearTEDS": _clear,
    "WriteToTEDSFromArray": _write("bit_stream"),
    "WriteToTEDSFromFile": _write("file_path"),
}
"""Calls of this module, by name."""
