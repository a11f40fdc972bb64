"""Sensors that describe themselves (TEDS, IEEE 1451.4): the data of a file that stands for a sensor's memory.

Read are the basic data (maker, model, version), the numbers of the templates, and of some templates what they
say: the unit of the measurand, the sensitivity of accelerometers, force sensors and microphones, the type of
thermocouples, and the coefficients of thermistors. (Where these stand was found by NI's own files and what
its tests read of them.) What else a template holds is not decoded; a bridge's data are then those of a full
bridge of 350 Ohm, as most are (estimate).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nidaqmx.constants import (
    AccelSensitivityUnits,
    BridgeConfiguration,
    ForceIEPESensorSensitivityUnits,
    TEDSUnits,
    ThermocoupleType,
)

from .errors import DaqmxError, DAQmxErrors
from .measurements import Measurement

_HEADER = 40
"""Entries of a file of bits before the sensor's own data."""
BASIC = 64
"""Bits of the basic data: maker 14, model 15, letter of the version 5, its number 6, serial number 24."""
_MEASURANDS = ("Kelvin", "Celsius", "strain", "microstrain", "Newton", "forcelb", "kgf", "m/s^2", "g")
"""Units by their number in templates of outputs in volts, milliamperes and of bridges (30, 31, 33)."""
_MEASURED = (30, 31, 33)
_THERMOCOUPLES = tuple(ThermocoupleType[letter].value for letter in "BEJKNRST")
"""Types by their number: K's was found, and that the others stand in order of their letters is inferred."""
_PER_NEWTON = ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON


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
        return 0 if self.number(BASIC, 2) else self.number(BASIC + 2, 8)

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
    def measured(self) -> dict[str, Any]:
        """Properties of a channel that the first template gives."""
        first = BASIC + 10
        match self.template:
            case 25 if not self.number(first + 1, 1):
                volts = 5e-7 * 1.0003 ** self.number(first + 2, 16)
                if self.number(first, 1):
                    return {
                        "AI_FORCE_IEPE_SENSOR_SENSITIVITY": 1e3 * volts,
                        "AI_FORCE_IEPE_SENSOR_SENSITIVITY_UNITS": _PER_NEWTON.value,
                    }
                return {
                    "AI_ACCEL_SENSITIVITY": 9.80665 * volts,
                    "AI_ACCEL_SENSITIVITY_UNITS": AccelSensitivityUnits.VOLTS_PER_G.value,
                }
            case 27 if not self.number(first, 1):
                return {"AI_MICROPHONE_SENSITIVITY": 1e3 * 1e-5 * 1.0002 ** self.number(first + 1, 16)}
            case 36 if (number := self.number(first + 36, 4)) < len(_THERMOCOUPLES):
                return {"AI_THRMCPL_TYPE": _THERMOCOUPLES[number]}
            case 38:
                numbers = [self.number(first + 78 + 32 * place, 32) for place in range(3)]
                floats = struct.unpack("<3f", struct.pack("<3I", *numbers))
                return {f"AI_THRMSTR_{name}": value for name, value in zip("ABC", floats, strict=True)}
        return {}

    @property
    def units(self) -> str:
        """Unit of the measurand, empty if it is not known."""
        if self.template not in _MEASURED:
            return ""
        number = self.number(BASIC + 10, 6)
        return _MEASURANDS[number] if number < len(_MEASURANDS) else ""


def teds_from_file(path: Path) -> Teds:
    """Read a file that holds one bit in a byte. Raises DaqmxError."""
    try:
        octets = path.read_bytes()
    except OSError:
        raise DaqmxError(
            DAQmxErrors.VIRTUAL_TEDS_FILE_NOT_FOUND, f"Virtual TEDS file cannot be found: {str(path)!r}."
        ) from None
    if len(octets) < _HEADER + BASIC or set(octets) - {0, 1}:
        raise DaqmxError(
            DAQmxErrors.VIRTUAL_TEDS_DATA_FILE_ERROR,
            f"{str(path)!r} is not a virtual TEDS file: a byte for a bit.",
        )
    return Teds(tuple(octets[_HEADER:]))


def not_detected(channel: str) -> DaqmxError:
    """The error of a physical channel without a sensor."""
    return DaqmxError(
        DAQmxErrors.TEDS_SENSOR_NOT_DETECTED,
        f"TEDS sensor is not detected at the physical channel {channel}.",
    )


def sensed(sensors: Mapping[str, Teds], channel: str, name: str) -> Any:
    """Return property `name` of the sensor at a physical channel. Raises DaqmxError without one."""
    if channel not in sensors:
        raise not_detected(channel)
    return sensors[channel].facts[name]


def teds_values(
    sensors: Mapping[str, Teds], name: str, row: Measurement, given: dict[str, Any]
) -> dict[str, Any]:
    """Return the properties that the sensor at `name` gives a channel. Raises DaqmxError without one."""
    sensor = sensors.get(name)
    if sensor is None:
        raise not_detected(name)
    values: dict[str, Any] = {"AI_IS_TEDS": True, "AI_TEDS_UNITS": sensor.units, **sensor.measured}
    if given.get(row.units) in (None, 0):
        values[row.units] = TEDSUnits.FROM_TEDS.value
    if row.usage.name.endswith("BRIDGE") or sensor.template == 33:
        values |= {
            "AI_BRIDGE_CFG": BridgeConfiguration.FULL_BRIDGE.value,
            "AI_BRIDGE_NOM_RESISTANCE": 350.0,
            "AI_EXCIT_USE_FOR_SCALING": True,
        }
    return values
