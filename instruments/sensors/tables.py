"""How a rig file describes sensors: by what they measure, with the numbers of their data sheets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import Field, GetJsonSchemaHandler
from pydantic_core import core_schema

from ...base.bounded import Finite, Positive
from .linear_table import LinearTable, in_units
from .sensor import LinearSensor
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
