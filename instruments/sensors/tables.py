"""The `[sensors]` table of a rig file: what each measures, with the numbers of its data sheet."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, field_validator, model_validator
from pydantic_core import core_schema

from ...base.bounded import Finite, Positive, Strict
from .linear_table import LinearTable, in_units
from .sensor import AnalogChannel, Divider, LinearSensor, Scale, Sensor, Switch
from .units import Dimensions, G, dimensions

_OUTPUT_RESISTANCE = 32e3
"""Resistance of each output of an ADXL335 (ohm; data sheet; docs/hardware.md, "Accelerometer")."""
_RATIOMETRIC_RANGE = 3.0 * G
"""Guaranteed range of an ADXL335 (m/s^2; data sheet; docs/hardware.md, "Accelerometer")."""
_RANK = 1e-6
"""Smallest singular value of a matrix, over the largest, of rows brought to one size."""


class ForceTable(LinearTable):
    """A force sensor: a load cell, a piezoelectric one, three axes, or gauges with a matrix (ATI Mini40).

    Weight and offset are taken off by the rest: volts are relative to the unloaded sensor. A force is
    positive when the button is pressed; give a negative scale or sensitivity to a cell that says otherwise.
    """

    measures = "force"
    per = "N"
    most = 6

    rated: Annotated[Positive, in_units("N")] | None = None
    """Load at which a bridge has its sensitivity ("2 mV/V"): N, or text ("5 kgf")."""
    matrix: Annotated[tuple[tuple[Finite, ...], ...], Field(min_length=1, max_length=6)] | None = None
    """SI per V: a row for each axis (N; N m for torques), a column for each channel."""
    calibration: str | None = None
    """Name of an ATI .cal file, in place of matrix, range and output."""
    serial: str | None = None
    """Serial number of the sensor that the file belongs to."""

    def _count(self) -> int:
        return len(self.channels) if self.matrix is None else len(self.matrix)

    def _matrix(self) -> tuple[tuple[float, ...], ...]:
        if self.matrix is None:
            if len(self.channels) > 3:
                raise ValueError(
                    f"{len(self.channels)} gauges need a matrix, or calibration (the name of a .cal file)"
                )
            return super()._matrix()
        if self.scale is not None or self.sensitivity is not None:
            raise ValueError("give either a matrix, or scale or sensitivity")
        columns = len(self.channels)
        for number, row in enumerate(self.matrix):
            if len(row) != columns:
                raise ValueError(f"row {number + 1} of matrix has {len(row)} numbers for {columns} channels")
        axes = self._axes()
        rows = np.array(self.matrix)
        sizes = np.linalg.norm(rows, axis=1)
        if not sizes.all():
            empty = axes[int(np.argmin(sizes))]
            raise ValueError(
                f"the row of matrix for {empty} is zero: leave it out, and name the other rows in axes"
            )
        values = np.linalg.svd(rows / sizes[:, None], compute_uv=False)
        if values[-1] < _RANK * values[0] or len(rows) > columns:
            raise ValueError(
                "the rows of matrix depend on each other, so that no load can be told from another: copy the "
                "UserAxis rows of the .cal file again, or name it in calibration"
            )
        return self.matrix

    def _voltage(self, value: float, found: Dimensions) -> float | None:
        if found == dimensions("V/V"):
            if self.excitation is None or self.rated is None:
                raise ValueError(
                    "a sensitivity in mV/V needs excitation (V) and rated (the load, N): "
                    "excitation = 5, rated = 50"
                )
            return value * self.excitation / self.rated
        return super()._voltage(value, found)

    def _needs(self) -> str:
        return "mV/N, mV/V (a bridge) or pC/N (a charge amplifier)"


class AccelerationTable(LinearTable):
    """An accelerometer of one to three axes.

    DC-coupled (MEMS) ones show gravity on their vertical axis at rest. One with `high_pass_hz` is AC-coupled
    (IEPE, charge) and shows nothing at rest. An ADXL335 (GY-61) is ratiometric: its sensitivity, zero and
    low-pass follow from the board's `supply` and the filter's `capacitor`, unless given:
    1 / (2 pi 32 kOhm C), 50 Hz as sold (0.1 uF), 500 Hz with 10 nF (data sheet; docs/hardware.md,
    "Accelerometer").
    """

    measures = "acceleration"
    per = "m/s^2"
    most = 3

    supply: Positive | None = None
    """Supply of an ADXL335 (V): a tenth of it per g, half of it at 0."""
    capacitor: Positive | None = None
    """Filter capacitor of each output of an ADXL335 (F)."""
    gravity: bool | None = None
    """False for a DC-coupled one whose axis of the press is not vertical."""

    def sensor(self) -> LinearSensor:
        """See `LinearTable.sensor`."""
        if self.supply is None:
            return super().sensor()
        filled: dict[str, Any] = {"range": (_RATIOMETRIC_RANGE,)}
        if self.scale is None and self.sensitivity is None:
            filled["sensitivity"] = (0.1 * self.supply / G,)
        if self.zero == (0.0,):
            filled["zero"] = (self.supply / 2,)
        if self.range is not None:
            del filled["range"]
        whole = self.model_copy(update=filled)
        made = super(AccelerationTable, whole).sensor()
        return made.model_copy(update={"stated": self._stated()}) if "sensitivity" in filled else made

    def _low_pass(self) -> float | None:
        if self.low_pass_hz is not None or self.capacitor is None:
            return self.low_pass_hz
        return float(1 / (2 * np.pi * _OUTPUT_RESISTANCE * self.capacitor))

    def _gravity(self) -> bool:
        coupled = self.high_pass_hz is None and self.time_constant is None
        if self.gravity and not coupled:
            raise ValueError(
                "an AC-coupled accelerometer shows no gravity: leave gravity out, or high_pass_hz"
            )
        return coupled if self.gravity is None else self.gravity

    def _needs(self) -> str:
        return "mV/g, mV/(m/s^2) or pC/g (a charge amplifier)"


class DisplacementTable(LinearTable):
    """A displacement sensor: laser triangulation, LVDT, a counter of an encoder (one channel, m per count).

    Travel rises as the button is pressed, from where the cap rests; give a negative scale to a sensor that
    says otherwise.
    """

    measures = "displacement"
    per = "m"

    def _voltage(self, value: float, found: Dimensions) -> float | None:
        if found == dimensions("V/V/m"):
            if self.excitation is None:
                raise ValueError("a sensitivity in mV/V/mm needs excitation (V): excitation = 3")
            return value * self.excitation
        return super()._voltage(value, found)

    def _needs(self) -> str:
        return "V/mm or mV/V/mm (an LVDT)"


class VelocityTable(LinearTable):
    """A velocity sensor aimed at the cap: a laser vibrometer. Positive upwards."""

    measures = "velocity"
    per = "m/s"

    def _needs(self) -> str:
        return "V/(m/s); or give scale, as '20 mm/s/V'"


class Described:
    """Marks a field of a model that holds a sensor, and that a rig file describes by a table."""

    def __init__(self, table: type[LinearTable]) -> None:
        self.table = table

    def __get_pydantic_core_schema__(
        self, source: Any, handler: Callable[[Any], core_schema.CoreSchema]
    ) -> core_schema.CoreSchema:
        """Read a table as the sensor that it describes; a sensor as a recording has it stays."""
        return core_schema.no_info_before_validator_function(self._read, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The keys of the table, for editors."""
        described = handler(self.table.__pydantic_core_schema__)
        return {"anyOf": [described, {"const": False}]}

    def _read(self, value: Any) -> Any:
        if value is False:
            return None
        if not isinstance(value, dict) or "measures" in value:
            return value
        return self.table.model_validate(value).sensor()


# The `[sensors]` table of a rig file.

_TAKEN = (
    *("force", "acceleration", "displacement", "velocity", "travel", "activation", "drive", "saturated"),
    *("time", "elapsed_time", "axis", "Fx", "Fy", "Fz", "Tx", "Ty", "Tz"),
)
"""Names that every recording, its exports and live views already use."""


def _none(value: Any) -> Any:
    return None if value is False else value


NotThere = BeforeValidator(_none)
"""False takes away what the base of a rig file has."""


class Sensors(Strict):
    """The `[sensors]` table of a rig file. Each is optional, and `false` takes away that of a base.

    What a step needs is asked by that step: recording needs force, displacement, acceleration or velocity, a
    representative press one of the last three, and a rig without a touch table needs no `drive`.
    """

    force: Annotated[LinearSensor | None, Described(ForceTable)] = None
    acceleration: Annotated[LinearSensor | None, Described(AccelerationTable)] = None
    displacement: Annotated[LinearSensor | None, Described(DisplacementTable)] = None
    velocity: Annotated[LinearSensor | None, Described(VelocityTable)] = None
    activation: Annotated[Switch | None, NotThere] = None
    drive: Annotated[Divider | None, NotThere] = None
    extra: dict[str, AnalogChannel] = Field(default_factory=dict)
    """Further channels recorded with presses, each under a name that the rig file chooses."""

    @property
    def linear(self) -> dict[str, LinearSensor]:
        """The linear sensors that there are, by what they measure."""
        found = (self.force, self.acceleration, self.displacement, self.velocity)
        return {sensor.measures: sensor for sensor in found if sensor is not None}

    @property
    def of_presses(self) -> dict[str, Sensor]:
        """The sensors that are recorded with presses, by what they measure."""
        found: dict[str, Sensor] = dict(self.linear)
        return found if self.activation is None else found | {"activation": self.activation}

    @property
    def recorded(self) -> tuple[str, ...]:
        """Channels that are recorded with presses, in the order of a recording."""
        names = [name for sensor in self.of_presses.values() for name in sensor.channels]
        return tuple(dict.fromkeys([*names, *(along.channel for along in self.extra.values())]))

    def scale_of(self, channel: str) -> tuple[str, Scale] | None:
        """Return the table of the sensor that reads a channel, and its scale.

        None when no sensor reads it, or one that has no scale for a channel alone: gauges and switches.
        """
        for name, sensor in self.linear.items():
            if channel in sensor.channels and (scale := _alone(sensor, channel)):
                return name, Scale(scale, sensor.unit)
        if self.drive is not None and channel in self.drive.channels:
            return "drive", Scale(self.drive.ratio, "V")
        for name, along in self.extra.items():
            if along.channel == channel:
                return f"extra.{name}", Scale(along.scale, along.unit)
        return None

    @field_validator("extra")
    @classmethod
    def _names(cls, extra: dict[str, AnalogChannel]) -> dict[str, AnalogChannel]:
        for name in extra:
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,39}", name):
                raise ValueError(
                    f"{name!r} is not a valid name: use up to 40 letters, digits and '_', beginning with a "
                    "letter"
                )
            if name in _TAKEN or name.startswith("acceleration_"):
                raise ValueError(f"{name!r} is the name of something that every recording has: use another")
        return extra

    @model_validator(mode="after")
    def _one_sensor_a_channel(self) -> Self:
        of: dict[str, str] = {}
        for table, channel in self._wired():
            if of.setdefault(channel, table) != table:
                raise ValueError(
                    f"{of[channel]} and {table} both read the channel {channel!r}: give each its own "
                    "channel, on a terminal of its own"
                )
        for table, sensor in {**self.of_presses, "drive": self.drive}.items():
            names = sensor.channels if sensor is not None else ()
            if doubled := [name for name in names if names.count(name) > 1]:
                raise ValueError(
                    f"{table} names the channel {doubled[0]!r} twice: name each of its wires once"
                )
        return self

    def _wired(self) -> Iterator[tuple[str, str]]:
        for table, sensor in {**self.of_presses, "drive": self.drive}.items():
            yield from ((table, name) for name in (sensor.channels if sensor is not None else ()))
        yield from ((f"extra.{name}", along.channel) for name, along in self.extra.items())


def _alone(sensor: LinearSensor, channel: str) -> float:
    """SI per volt of a channel that alone makes an axis; 0 for another."""
    column = sensor.channels.index(channel)
    used = [row for row in sensor.matrix if row[column]]
    alone = [row[column] for row in used if sum(map(bool, row)) == 1]
    return alone[0] if len(used) == 1 and alone else 0.0
