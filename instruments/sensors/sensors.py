"""The `[sensors]` table of a rig file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator

from ..frozen import FrozenDict
from .sensor import AnalogChannel, Divider, LinearSensor, Scale, Sensor, Switch
from .tables import AccelerationTable, Described, DisplacementTable, ForceTable, VelocityTable

_TAKEN = (
    *("force", "acceleration", "displacement", "velocity", "travel", "activation", "drive", "saturated"),
    *("time", "elapsed_time", "axis", "Fx", "Fy", "Fz", "Tx", "Ty", "Tz"),
)
"""Names that every recording, its exports and live views already use."""


def _none(value: Any) -> Any:
    return None if value is False else value


NotThere = BeforeValidator(_none)
"""False takes away what the base of a rig file has."""


class Sensors(BaseModel):
    """The `[sensors]` table of a rig file. Each is optional, and `false` takes away that of a base.

    What a step needs is asked by that step: recording needs force, displacement, acceleration or velocity, a
    representative press one of the last three, and a rig without a touch table needs no `drive`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    force: Annotated[LinearSensor | None, Described(ForceTable)] = None
    acceleration: Annotated[LinearSensor | None, Described(AccelerationTable)] = None
    displacement: Annotated[LinearSensor | None, Described(DisplacementTable)] = None
    velocity: Annotated[LinearSensor | None, Described(VelocityTable)] = None
    activation: Annotated[Switch | None, NotThere] = None
    drive: Annotated[Divider | None, NotThere] = None
    extra: dict[str, AnalogChannel] = Field(default_factory=FrozenDict)
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
        return FrozenDict(extra)

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
