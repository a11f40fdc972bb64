"""Read ATI's `.cal` file of a DAQ force sensor, and convert its matrix to SI.

Only the UserAxis rows are read: the file itself names them for a user's own software, and they include
the tool transform (docs/hardware.md, "Force sensor"). The Axis rows are not read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

from ...base.errors import ConfigurationError

_AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
_LONGEST = 1 << 20
_POUND_FORCE = 4.4482216152605
_INCH = 0.0254
_FORCE = {"N": 1.0, "kN": 1e3, "lb": _POUND_FORCE, "lbf": _POUND_FORCE, "kg": 9.80665, "kgf": 9.80665}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": _INCH, "ft": 12 * _INCH}


@dataclass(frozen=True)
class AtiCalibration:
    """Content of a `.cal` file, in SI."""

    serial: str
    """Serial number of the transducer (FT12345): compare it with the one on the sensor."""
    part_number: str
    """Name of this calibration among those of the sensor (SI-40-2)."""
    date: str
    matrix: tuple[tuple[float, ...], ...]
    """Rows Fx, Fy, Fz (N per V), Tx, Ty, Tz (N m per V); a column for each gauge."""
    ratings: tuple[float, ...]
    """Full scale of each axis (N, N m)."""
    gauge_range: float
    """Full scale of a gauge's output (V)."""

    @property
    def table(self) -> dict[str, Any]:
        """Keys of `[sensors.force]` that the file states."""
        return {
            "matrix": self.matrix,
            "range": self.ratings,
            "output": self.gauge_range,
            "serial": self.serial,
        }


def read_ati_cal(path: str | Path) -> AtiCalibration:
    """Read a `.cal` file. Raises ConfigurationError, which names the file and the fault."""
    try:
        return _calibration(_parsed(Path(path)))
    except _FileError as wrong:
        raise ConfigurationError(f"The calibration file {path} cannot be used: {wrong}.") from None


class _FileError(Exception):
    """Fault of the file, with its remedy."""


class _Plain(Xml.TreeBuilder):
    """Refuses a document type: no calibration file needs one, and its entities could read other files."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise _FileError("it declares a document type, which no file of ATI's does; get the original")


def _parsed(path: Path) -> Xml.Element:
    try:
        if path.stat().st_size > _LONGEST:
            raise _FileError("it is far too long for a .cal file; get the original")
        return Xml.fromstring(path.read_bytes(), Xml.XMLParser(target=_Plain()))
    except OSError as error:
        raise _FileError(f"{error.strerror or error}; correct the path") from None
    except (Xml.ParseError, ValueError, LookupError) as error:
        raise _FileError(
            f"it is no XML ({error}); get the original from ATI's CD or by serial number"
        ) from None


def _calibration(root: Xml.Element) -> AtiCalibration:
    calibrations = root.findall("Calibration")
    if root.tag != "FTSensor" or len(calibrations) != 1:
        raise _FileError(f"it holds {len(calibrations)} calibrations of an FTSensor, where 1 is expected")
    calibration = calibrations[0]
    gauges = root.get("NumGages", "6")
    if gauges != "6":
        raise _FileError(f"its sensor has {gauges} gauges, where 6 are expected")
    rows = {row.get("Name", ""): row for row in calibration.findall("UserAxis")}
    if not rows:
        raise _FileError(
            f"it is of version {root.get('CalFileVersion', 'unknown')} and has no UserAxis rows; "
            "ask ATI for a file of version 1.1, by the sensor's serial number"
        )
    missing = [axis for axis in _AXES if axis not in rows]
    if missing:
        raise _FileError(f"it has no UserAxis row {missing[0]}; get the original")
    force = _unit(calibration, "ForceUnits", _FORCE)
    scales = dict(zip(_AXES, [force] * 3 + [_torque(calibration)] * 3, strict=True))
    matrix = tuple(tuple(v * scales[a] for v in _numbers(rows[a], "values", 6)) for a in _AXES)
    ratings = tuple(_positive(rows[a], "max") * scales[a] for a in _AXES)
    if all(v == 0 for row in matrix for v in row):
        raise _FileError("its matrix is zero; get the original")
    bipolar = _attribute(calibration, "OutputBipolar").lower() == "true"
    return AtiCalibration(
        serial=_attribute(root, "Serial"),
        part_number=calibration.get("PartNumber", ""),
        date=calibration.get("CalDate", ""),
        matrix=matrix,
        ratings=ratings,
        gauge_range=_positive(calibration, "OutputRange") / (2 if bipolar else 1),
    )


def _torque(calibration: Xml.Element) -> float:
    """Convert the unit of torque, a force and a length in either order (N-mm, in-lbf), to N m."""
    text = _attribute(calibration, "TorqueUnits")
    words = text.split("-")
    for first, second in (words, words[::-1]) if len(words) == 2 else ():
        if first in _FORCE and second in _LENGTH:
            return _FORCE[first] * _LENGTH[second]
    raise _FileError(f"its TorqueUnits are {text!r}, where a force and a length like N-m are expected")


def _unit(element: Xml.Element, name: str, known: dict[str, float]) -> float:
    text = _attribute(element, name)
    if text not in known:
        raise _FileError(f"its {name} are {text!r}, where one of {', '.join(known)} is expected")
    return known[text]


def _attribute(element: Xml.Element, name: str) -> str:
    text = element.get(name, "").strip()
    if not text:
        raise _FileError(f"{element.tag} has no {name}; get the original")
    return text


def _positive(element: Xml.Element, name: str) -> float:
    (value,) = _numbers(element, name, 1)
    if value <= 0:
        raise _FileError(
            f"{name} of {element.tag} {element.get('Name', '')} is {value:g}, where more is expected"
        )
    return value


def _numbers(element: Xml.Element, name: str, count: int) -> list[float]:
    text = _attribute(element, name)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise _FileError(
            f"{name} of {element.tag} {element.get('Name', '')} are {text[:60]!r}, where {count} "
            f"number{'s are' if count > 1 else ' is'} expected"
        )
    return values
