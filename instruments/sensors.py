"""Sensors: values that convert volts to SI, with their range, bandwidth and delay.

A sensor is not an instrument: it has no connection of its own. It is defined in the rig file and stored
in every recording. Bandwidth and delay are known because two signals are compared only after both have
been brought to the same bandwidth and time.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from .arrays import BoolArray, ComplexArray, FloatArray
from .bounded import Finite, Positive
from .frozen import FrozenDict

__all__ = [
    "Accelerometer",
    "AnalogChannel",
    "Divider",
    "ForceTorque",
    "Scale",
    "Sensor",
    "Sensors",
    "Switch",
    "low_pass",
]


_TAKEN = (
    *("force", "acceleration", "activation", "drive", "saturated", "time", "elapsed_time", "axis"),
    *("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"),
)
"""Names that every recording, its exports and live views already use."""

_G = 9.80665
_TILT = 0.35 * _G
"""The zero-g tolerance of an ADXL335 is 0.3 g on z (estimate; docs/hardware.md, "Accelerometer"), and a
little more is allowed."""
_OUTPUT_RESISTANCE = 32e3
"""Resistance of each output of an ADXL335 (ohm; data sheet; docs/hardware.md, "Accelerometer")."""


def _not_zero(scale: float) -> float:
    if scale == 0:
        raise ValueError("a scale of 0 would lose what is measured: give units per volt")
    return scale


def low_pass(frequencies: FloatArray, corner_hz: float) -> ComplexArray:
    """Response of one real pole at `corner_hz` to `frequencies` (Hz), unity at 0 Hz."""
    return np.asarray(1.0 / (1.0 + 1j * frequencies / corner_hz), dtype=np.complex128)


@dataclass(frozen=True)
class Scale:
    """What a volt on a channel stands for."""

    per_volt: float
    unit: str

    def __str__(self) -> str:
        return f"{self.per_volt:.4g} {self.unit} per V"


class Sensor(BaseModel, ABC):
    """Base of all sensors. `channels` names the DAQ channels that it is wired to, in its own order."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    channels: tuple[str, ...]

    @abstractmethod
    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (channels, samples) V, in the order of `channels`, to (quantities, samples) SI."""

    @abstractmethod
    def saturated(self, volts: FloatArray) -> BoolArray:
        """(samples,): True where the sensor was at the end of its range, so that `to_si` is invalid."""

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Frequency response at `frequencies` (Hz), relative to `to_si`, which holds at low frequency."""
        return np.ones(len(frequencies), dtype=np.complex128)


class ForceTorque(Sensor):
    """Six strain gauges with the matrix of their calibration file (ATI Mini40, DAQ version).

    `matrix` is the file's six UserAxis rows (Fx, Fy, Fz in N, Tx, Ty, Tz in N m per V), as
    docs/hardware.md, "Force sensor" explains; `ratings` are the axes' full scales. Volts are relative to
    the unloaded sensor: subtract the gauges' rest before the call, or the result includes weight and offset.
    """

    channels: Annotated[tuple[str, ...], Field(min_length=6, max_length=6)]
    matrix: Annotated[
        tuple[Annotated[tuple[Finite, ...], Field(min_length=6, max_length=6)], ...],
        Field(min_length=6, max_length=6),
    ]
    ratings: Annotated[tuple[Positive, ...], Field(min_length=6, max_length=6)]
    gauge_range: Positive = 10.0
    calibration: str | None = None
    """Name of the calibration file that these values come from, if any."""
    serial: str | None = None
    """Serial number of the sensor that the file belongs to."""

    @field_validator("matrix")
    @classmethod
    def _reads_fz(cls, matrix: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        if not any(matrix[2]):
            raise ValueError("its third row, Fz, is zero: no press could be seen")
        return matrix

    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (6, samples) V above rest to (6, samples): Fx, Fy, Fz (N), Tx, Ty, Tz (N m)."""
        return np.asarray(self.matrix) @ volts

    def saturated(self, volts: FloatArray) -> BoolArray:
        """See `Sensor.saturated`: a gauge at its output range, or an axis beyond its rating."""
        beyond = np.abs(self.to_si(volts)) > np.asarray(self.ratings)[:, None]
        return np.asarray(np.any(np.abs(volts) >= self.gauge_range, axis=0) | np.any(beyond, axis=0))


class Accelerometer(Sensor):
    """A three-axis analog accelerometer (ADXL335 on a GY-61 board).

    The part is ratiometric: `sensitivity` (V per m/s^2; a tenth of the supply per g) and `zero` (V at
    0 m/s^2; half of it) follow from the board's `supply` (V), unless measured values are given.
    Likewise `bandwidth_hz` follows from the filter's `capacitor` (F): 1 / (2 pi 32 kOhm
    C), 50 Hz as sold (0.1 uF), 500 Hz with 10 nF (ADXL335 data sheet; docs/hardware.md, "Accelerometer").
    """

    channels: Annotated[tuple[str, ...], Field(min_length=3, max_length=3)]
    sensitivity: Positive
    zero: Finite
    bandwidth_hz: Positive
    range: Positive = 3.0 * _G
    supply: Positive | None = None
    capacitor: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _derived(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        derived = {}
        supply, capacitor = given.get("supply"), given.get("capacitor")
        if isinstance(supply, int | float) and supply > 0:
            derived = {"sensitivity": 0.1 * supply / _G, "zero": supply / 2}
        if isinstance(capacitor, int | float) and capacitor > 0:
            derived["bandwidth_hz"] = 1 / (2 * np.pi * _OUTPUT_RESISTANCE * capacitor)
        return {**derived, **given}

    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (3, samples) V to (3, samples) m/s^2 along x, y, z."""
        return (volts - self.zero) / self.sensitivity

    def saturated(self, volts: FloatArray) -> BoolArray:
        """See `Sensor.saturated`: an axis beyond the guaranteed range."""
        return np.asarray(np.any(np.abs(self.to_si(volts)) >= self.range, axis=0))

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Frequency response of the filter capacitor's pole."""
        return low_pass(frequencies, self.bandwidth_hz)

    def fault_at_rest(self, volts: FloatArray) -> str | None:
        """Describe the fault of an accelerometer that shows (3, samples) V at rest, z up; None without."""
        x, y, _ = self.to_si(volts).mean(axis=1)
        if wrong := self.fault_along_z(volts):
            return f"{wrong}."
        if max(abs(x), abs(y)) > _TILT:
            return "x and y must show nothing: mount it level, or check its wires."
        return None

    def fault_along_z(self, volts: FloatArray) -> str | None:
        """Describe, as a clause, the fault of the vertical axis in (3, samples) V at rest; None without."""
        if self.upside_down(volts):
            return "it is mounted upside down, z must point up: turn it over"
        if abs(float(self.to_si(volts)[2].mean()) - _G) > _TILT:
            return (
                "z must show 9.8: check how it is mounted, its supply, and sensitivity and zero in the rig "
                "file"
            )
        return None

    def upside_down(self, volts: FloatArray) -> bool:
        """True when (3, samples) V at rest show gravity along -z."""
        return abs(float(self.to_si(volts)[2].mean()) + _G) < _TILT

    def loss(self, frequency_hz: float) -> str | None:
        """Describe the attenuation by the capacitor at a frequency; None when it is less than 3 dB."""
        gain = complex(self.response(np.array([frequency_hz]))[0])
        if abs(gain) >= np.sqrt(0.5):
            return None
        level, late = 20 * np.log10(abs(gain)), -np.degrees(np.angle(gain))
        return (
            f"The accelerometer passes {self.bandwidth_hz:.0f} Hz: of a vibration at {frequency_hz:.1f} Hz "
            f"it records {abs(gain):.0%} ({level:.1f} dB), {late:.0f} degrees late, and what is recorded "
            "is what is rendered. Change its filter capacitors."
        )


class Switch(Sensor):
    """A contact that switches a voltage: the button's activation state."""

    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=1)]
    threshold: Positive = 2.5

    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (1, samples) V to (1, samples): 1.0 where the contact is closed, 0.0 where it is open."""
        return np.asarray(volts > self.threshold, dtype=np.float64)

    def saturated(self, volts: FloatArray) -> BoolArray:
        """See `Sensor.saturated`: a switch has no range to leave."""
        return np.zeros(volts.shape[1], dtype=np.bool_)


class Divider(Sensor):
    """The voltage at the patches, measured through a divider: a drive is never assumed.

    A single channel measures the bus behind the relay, common to all patches; several measure one patch
    each, in the order of the table's `patches`, where an amplifier has a channel for each.
    """

    channels: Annotated[tuple[str, ...], Field(min_length=1)]
    ratio: Positive
    """Volts at the patch per volt at the DAQ."""

    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (channels, samples) V at the DAQ to (channels, samples) V at the patches."""
        return volts * self.ratio

    def saturated(self, volts: FloatArray) -> BoolArray:
        """See `Sensor.saturated`: the DAQ's own range is the limit, and its blocks flag that."""
        return np.zeros(volts.shape[1], dtype=np.bool_)


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("use characters that can be printed")
    return text


class AnalogChannel(BaseModel):
    """A further channel of the DAQ recorded with presses: `value = scale * volts + offset`, in `unit`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    channel: str
    scale: Annotated[Finite, AfterValidator(_not_zero)] = 1.0
    """Units per volt."""
    offset: Finite = 0.0
    """Value at 0 V, in `unit`."""
    unit: Annotated[str, Field(max_length=16), AfterValidator(_printable)] = "V"
    name: Annotated[str, Field(max_length=60), AfterValidator(_printable)] = ""
    """Label in displays and plots; empty for the key in the rig file."""

    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (samples,) V to (samples,) in `unit`."""
        return self.scale * volts + self.offset


class Sensors(BaseModel):
    """The `[sensors]` table of a rig file. Each is optional: a rig without a table needs no `drive`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    force: ForceTorque | None = None
    acceleration: Accelerometer | None = None
    activation: Switch | None = None
    drive: Divider | None = None
    extra: dict[str, AnalogChannel] = Field(default_factory=FrozenDict)
    """Further channels recorded with presses, each under a name that the rig file chooses."""

    @property
    def recorded(self) -> tuple[str, ...]:
        """Channels that are recorded with presses, in the order of a recording."""
        used = [sensor for sensor in (self.force, self.acceleration, self.activation) if sensor]
        names = [name for sensor in used for name in sensor.channels]
        return tuple(dict.fromkeys([*names, *(along.channel for along in self.extra.values())]))

    def scale_of(self, channel: str) -> tuple[str, Scale] | None:
        """Return the table of the sensor that reads a channel, and its scale.

        None when no sensor reads it, or one that has no scale for a channel alone: gauges and switches.
        """
        if self.acceleration is not None and channel in self.acceleration.channels:
            return "acceleration", Scale(1 / self.acceleration.sensitivity, "m/s^2")
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
        return FrozenDict(extra)
