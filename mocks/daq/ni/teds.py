"""Sensors that describe themselves (TEDS, IEEE 1451.4): the data of a file that stands for a sensor's memory.

Read are the basic data (maker, model, version), the numbers of the templates, and what a template of those
below says first: the unit of the measurand. What else a template holds is not decoded; a bridge's data are
then those of a full bridge of 350 Ohm, as most are (estimate).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nidaqmx.constants import BridgeConfiguration, TEDSUnits

from .errors import DaqmxError, DAQmxErrors
from .measurements import Measurement

if TYPE_CHECKING:
    from .devices import NiDevice
    from .system import NiSystem

__all__ = ["TEDS", "Teds", "sensed", "teds_values"]

Call = Callable[["NiSystem", Any, Callable[[], bool]], Any]

_HEADER = 40
"""Entries of a file of bits before the sensor's own data."""
_BASIC = 64
"""Bits of the basic data: maker 14, model 15, letter of the version 5, its number 6, serial number 24."""
_MEASURANDS = ("Kelvin", "Celsius", "strain", "microstrain", "Newton", "forcelb", "kgf", "m/s^2", "g")
"""Units by their number in templates of outputs in volts, milliamperes and of bridges (30, 31, 33)."""
_MEASURED = (30, 31, 33)


@dataclass(frozen=True)
class Teds:
    """The memory of one sensor, as bits; the first bit of a number is its lowest."""

    bits: tuple[int, ...]

    def number(self, first: int, count: int) -> int:
        """Return the number in `count` bits from `first` on."""
        return sum(bit << place for place, bit in enumerate(self.bits[first : first + count]))

    @property
    def octets(self) -> bytes:
        """All bits, eight in a byte."""
        return bytes(self.number(first, 8) for first in range(0, len(self.bits), 8))

    @property
    def template(self) -> int:
        """Number of the first template, 0 without one."""
        return 0 if self.number(_BASIC, 2) else self.number(_BASIC + 2, 8)

    @property
    def facts(self) -> dict[str, Any]:
        """NI's properties of a physical channel that has this sensor."""
        return {
            "PHYSICAL_CHAN_TEDS_MFG_ID": self.number(0, 14),
            "PHYSICAL_CHAN_TEDS_MODEL_NUM": self.number(14, 15),
            "PHYSICAL_CHAN_TEDS_VERSION_LETTER": chr(ord("A") + self.number(29, 5) - 1),
            "PHYSICAL_CHAN_TEDS_VERSION_NUM": self.number(34, 6),
            "PHYSICAL_CHAN_TEDS_SERIAL_NUM": self.number(40, 24),
            "PHYSICAL_CHAN_TEDS_BIT_STREAM": self.octets,
            "PHYSICAL_CHAN_TEDS_TEMPLATE_I_DS": [self.template] if self.template else [],
        }

    @property
    def units(self) -> str:
        """Unit of the measurand, empty if it is not known."""
        if self.template not in _MEASURED:
            return ""
        number = self.number(_BASIC + 10, 6)
        return _MEASURANDS[number] if number < len(_MEASURANDS) else ""


def _from_file(path: Path) -> Teds:
    """Read a file that holds one bit in a byte. Raises DaqmxError."""
    try:
        octets = path.read_bytes()
    except OSError:
        raise DaqmxError(
            DAQmxErrors.VIRTUAL_TEDS_FILE_NOT_FOUND, f"Virtual TEDS file cannot be found: {str(path)!r}."
        ) from None
    if len(octets) < _HEADER + _BASIC or set(octets) - {0, 1}:
        raise DaqmxError(
            DAQmxErrors.VIRTUAL_TEDS_DATA_FILE_ERROR,
            f"{str(path)!r} is not a virtual TEDS file: a byte for a bit.",
        )
    return Teds(tuple(octets[_HEADER:]))


def _not_detected(channel: str) -> DaqmxError:
    return DaqmxError(
        DAQmxErrors.TEDS_SENSOR_NOT_DETECTED,
        f"TEDS sensor is not detected at the physical channel {channel}.",
    )


def sensed(system: NiSystem, channel: str, name: str) -> Any:
    """Return property `name` of the sensor at a physical channel. Raises DaqmxError without one."""
    if channel not in system.teds:
        raise _not_detected(channel)
    return system.teds[channel].facts[name]


def teds_values(
    system: NiSystem, device: NiDevice, tail: str, row: Measurement, given: dict[str, Any]
) -> dict[str, Any]:
    """Return the properties that a sensor gives a channel. Raises DaqmxError without a sensor."""
    name = f"{device.name}/{tail}"
    sensor = system.teds.get(name)
    if sensor is None:
        raise _not_detected(name)
    values: dict[str, Any] = {"AI_IS_TEDS": True, "AI_TEDS_UNITS": sensor.units}
    if given.get(row.units) in (None, 0):
        values[row.units] = TEDSUnits.FROM_TEDS.value
    if row.usage.name.endswith("BRIDGE") or sensor.template == 33:
        values |= {
            "AI_BRIDGE_CFG": BridgeConfiguration.FULL_BRIDGE.value,
            "AI_BRIDGE_NOM_RESISTANCE": 350.0,
            "AI_EXCIT_USE_FOR_SCALING": True,
        }
    return values


def _configure(system: NiSystem, request: Any, alive: Callable[[], bool]) -> None:
    for device, tail in system.inventory.resolve(request.physical_channel):
        if not request.file_path:
            raise _not_detected(f"{device.name}/{tail}")
        system.teds[f"{device.name}/{tail}"] = _from_file(Path(request.file_path))


def _clear(system: NiSystem, request: Any, alive: Callable[[], bool]) -> None:
    for device, tail in system.inventory.resolve(request.physical_channel):
        system.teds.pop(f"{device.name}/{tail}", None)


def _write(of: str) -> Call:
    """Make a call that writes into a sensor's memory: there is none here that can be written to."""

    def call(system: NiSystem, request: Any, alive: Callable[[], bool]) -> None:
        ((device, tail), *_) = system.inventory.resolve(request.physical_channel)
        given = getattr(request, of)
        if of == "file_path" and given:
            _from_file(Path(given))
        elif len(given) * 8 < _BASIC:
            raise DaqmxError(
                DAQmxErrors.TEDS_SENSOR_DATA_ERROR, "TEDS sensor data are not valid: too few bits."
            )
        raise _not_detected(f"{device.name}/{tail}")

    return call


TEDS: dict[str, Call] = {
    "ConfigureTEDS": _configure,
    "ClearTEDS": _clear,
    "WriteToTEDSFromArray": _write("bit_stream"),
    "WriteToTEDSFromFile": _write("file_path"),
}
"""Calls of this module, by name."""
