"""Sensors: values that convert volts to SI, with their range, response and rest.

A sensor is not an instrument: it has no connection of its own. It is described in the rig file by what it
measures (`tables.py`) and stored in every recording as it is used. Its response is known because two
signals are compared only after both have been brought to the same bandwidth and time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.bounded import Finite, Positive, Strict
from .transfer import Transfer

Motion = Literal["force", "acceleration", "displacement", "velocity"]
"""What a linear sensor measures. Force and displacement rise as a button is pressed; acceleration and
velocity are positive upwards."""
UNITS: Mapping[str, str] = {"force": "N", "acceleration": "m/s^2", "displacement": "m", "velocity": "m/s"}


def _not_zero(scale: float) -> float:
    if scale == 0:
        raise ValueError("a scale of 0 would lose what is measured: give units per volt")
    return scale


@dataclass(frozen=True)
class Scale:
    """What a volt on a channel stands for."""

    per_volt: float
    unit: str

    def __str__(self) -> str:
        return f"{self.per_volt:.4g} {self.unit} per V"


class Sensor(Strict, ABC):
    """Base of all sensors. `channels` names the DAQ channels that it is wired to, in its own order."""

    channels: Annotated[tuple[str, ...], Field(min_length=1)]

    @property
    @abstractmethod
    def labels(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each quantity of `to_si`."""

    @abstractmethod
    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (channels, samples) V, in the order of `channels`, to (quantities, samples) SI."""

    @abstractmethod
    def saturated(self, volts: FloatArray) -> BoolArray:
        """(samples,): True where the sensor was at the end of its range, so that `to_si` is invalid."""

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Frequency response at `frequencies` (Hz), relative to `to_si`."""
        return np.ones(len(frequencies), dtype=np.complex128)


class LinearSensor(Sensor):
    """A sensor whose quantities are a linear map of its channels' volts: `matrix @ (volts - zero)`."""

    measures: Motion
    axes: tuple[str, ...]
    """Name of each quantity: x, y, z, and rx, ry, rz for torques about them."""
    matrix: tuple[tuple[Finite, ...], ...]
    """(axes, channels) SI per V."""
    zero: tuple[Finite, ...]
    """(channels,) V at 0. What shows a rest of its own (`tared`) is relative to that rest."""
    range: tuple[Positive, ...] | None = None
    """(axes,) largest magnitude in SI; None where none is stated."""
    output: Positive | None = None
    """Largest magnitude of the volts that it can put out; None where none is stated."""
    vertical: str
    """Axis along which buttons are pressed; with a "-" when it is mounted the other way round."""
    gravity: bool = False
    """True for what shows gravity at rest: an accelerometer that passes 0 Hz, and has a vertical axis."""
    transfer: Transfer = Transfer()
    stated: Mapping[str, Any] = {}
    """What the rig file says besides, as a data sheet does: a sensitivity, a calibration file."""

    @model_validator(mode="after")
    def _shapes(self) -> Self:
        rows, columns = len(self.axes), len(self.channels)
        if len(self.matrix) != rows or any(len(row) != columns for row in self.matrix):
            raise ValueError(
                f"matrix must have {rows} rows of {columns} numbers: an axis each, a channel each"
            )
        if len(self.zero) != columns or (self.range is not None and len(self.range) != rows):
            raise ValueError("zero must have a number a channel, and range one an axis")
        if self.vertical.removeprefix("-") not in self.axes:
            raise ValueError(f"vertical is {self.vertical!r}: use one of {', '.join(self.axes)}")
        return self

    @property
    def unit(self) -> str:
        """Unit of the quantities; of torques, N m."""
        return UNITS[self.measures]

    @property
    def labels(self) -> tuple[tuple[str, str], ...]:
        """See `Sensor.labels`."""
        if self.measures == "force":
            names = [f"T{axis[1]}" if axis.startswith("r") else f"F{axis}" for axis in self.axes]
            return tuple((name, "N m" if name.startswith("T") else "N") for name in names)
        if self.axes == ("z",):
            return ((self.measures, self.unit),)
        return tuple((f"{self.measures} {axis}", self.unit) for axis in self.axes)

    @property
    def row(self) -> int:
        """Index of the vertical axis."""
        return self.axes.index(self.vertical.removeprefix("-"))

    @property
    def sign(self) -> int:
        """-1 where the vertical axis is mounted the other way round."""
        return -1 if self.vertical.startswith("-") else 1

    @property
    def tared(self) -> bool:
        """True for what is measured from its own rest: a force, because of weight and offset; a travel."""
        return self.measures in ("force", "displacement")

    @property
    def ac_coupled(self) -> bool:
        """True when it shows nothing that is constant."""
        return bool(self.transfer.high_pass_hz)

    @property
    def bandwidth_hz(self) -> float:
        """Frequency from which it passes 3 dB less; infinite where nothing limits it."""
        return self.transfer.bandwidth_hz

    @property
    def weights(self) -> FloatArray:
        """(channels,) share of each channel in the vertical axis, SI per V, with the sign of the mounting."""
        return self.sign * np.array(self.matrix[self.row])

    def to_si(self, volts: FloatArray, rest: FloatArray | None = None) -> FloatArray:
        """Convert (channels, samples) V to (axes, samples); (channels,) V of a `rest` replace `zero`."""
        return np.asarray(np.array(self.matrix) @ (volts - self._base(rest)))

    def along(self, volts: FloatArray, rest: FloatArray | None = None) -> FloatArray:
        """Convert (channels, samples) V to (samples,) along the vertical axis, as `to_si`."""
        return np.asarray(self.weights @ (volts - self._base(rest)))

    def saturated(self, volts: FloatArray, rest: FloatArray | None = None) -> BoolArray:
        """See `Sensor.saturated`: an axis beyond its range, or a channel at the end of its output."""
        beyond = np.zeros(volts.shape[1], dtype=np.bool_)
        if self.range is not None:
            beyond |= np.any(np.abs(self.to_si(volts, rest)) >= np.array(self.range)[:, None], axis=0)
        if self.output is not None:
            beyond |= np.any(np.abs(volts) >= self.output, axis=0)
        return beyond

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """See `Sensor.response`."""
        return self.transfer.response(frequencies)

    def _base(self, rest: FloatArray | None) -> FloatArray:
        return np.asarray(self.zero if rest is None else rest, dtype=np.float64).reshape(-1, 1)


class Switch(Sensor):
    """A contact that switches a voltage: the button's activation state."""

    measures: ClassVar[str] = "activation"

    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=1)]
    threshold: Finite = 2.5
    """V that separate the states."""
    closed: Literal["high", "low"] = "high"
    """Level of the closed contact: low for one that pulls its line to ground."""

    @property
    def labels(self) -> tuple[tuple[str, str], ...]:
        """See `Sensor.labels`."""
        return (("activation", ""),)

    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert (1, samples) V to (1, samples): 1.0 where the contact is closed, 0.0 where it is open."""
        return np.asarray((volts > self.threshold) == (self.closed == "high"), dtype=np.float64)

    def saturated(self, volts: FloatArray) -> BoolArray:
        """See `Sensor.saturated`: a switch has no range to leave."""
        return np.zeros(volts.shape[1], dtype=np.bool_)


class Divider(Sensor):
    """The voltage at the patches, measured through a divider: a drive is never assumed.

    A single channel measures the bus behind the relay, common to all patches; several measure one patch
    each, in the order of the table's `patches`, where an amplifier has a channel for each.
    """

    measures: ClassVar[str] = "drive"

    ratio: Positive
    """Volts at the patch per volt at the DAQ."""

    @property
    def labels(self) -> tuple[tuple[str, str], ...]:
        """See `Sensor.labels`."""
        return tuple((f"{channel} at the patch", "V") for channel in self.channels)

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


class AnalogChannel(Strict):
    """A further channel of the DAQ recorded with presses: `value = scale * volts + offset`, in `unit`."""

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
