"""The instruments of a rig, each by its role, and the limits of the drive that follow from them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, TypeVar

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.clock import Clock
from ...base.entry_points import role_class
from ...base.errors import ConfigurationError
from ..amplifier import Amplifier
from ..config import Actuator, RigFile, TableSettings
from ..daq import Daq
from ..generator import Generator
from ..limits import Limits
from ..operator import Aim, Operator
from ..player import Player
from ..relay import Relay
from ..sensors import Divider, Sensors
from ..vibrometer import Vibrometer

Role = TypeVar("Role")
Part = TypeVar("Part")


class Instruments:
    """The open instruments of a rig file. Access to one that the rig lacks raises ConfigurationError."""

    def __init__(self, file: RigFile, clock: Clock) -> None:
        self._file = file
        self.clock = clock
        self._roles: dict[str, Any] = {}

    def _copied(self, part: Part) -> Part:
        """A part of the file as whoever asks gets it."""
        return part

    @property
    def file(self) -> RigFile:
        """The rig file."""
        return self._copied(self._file)

    @property
    def name(self) -> str:
        """The rig's name, from its file."""
        return self._file.name

    @property
    def sensors(self) -> Sensors:
        """The rig's sensors."""
        return self._copied(self._file.sensors)

    @property
    def table(self) -> TableSettings:
        """The touch table. Raises ConfigurationError for a rig that has none."""
        if self._file.table is None:
            raise ConfigurationError(f"The rig {self.name!r} has no [table]; this step needs one.")
        return self._copied(self._file.table)

    @property
    def actuator(self) -> Actuator:
        """What drives each patch. Raises ConfigurationError for a rig that has none."""
        if self._file.actuator is None:
            raise ConfigurationError(
                f"The rig {self.name!r} has no [actuator]; this step needs one: write what is glued to the "
                "table, and what it takes."
            )
        return self._copied(self._file.actuator)

    @property
    def instruments(self) -> Mapping[str, Any]:
        """Every open instrument by its role, in the order of opening."""
        return MappingProxyType(self._roles)

    def role(self, kind: type[Role]) -> Role:
        """The instrument of a role, named by the role's class. Raises ConfigurationError without one."""
        name = kind.__name__.lower()
        instrument = self._roles.get(name)
        if not isinstance(instrument, kind):
            # A role of another package may have another name than its class.
            name = next((role for role in self._roles if role_class(role) is kind), name)
            instrument = self._roles.get(name)
        if not isinstance(instrument, kind):
            instead = ', or wiring = "direct" (docs/explanation/safety.md)' if name == "relay" else ""
            raise ConfigurationError(f"The rig {self.name!r} has no [{name}]; this step needs one{instead}.")
        return instrument

    @property
    def daq(self) -> Daq:
        """The DAQ."""
        return self.role(Daq)

    @property
    def amplifier(self) -> Amplifier:
        """The amplifier. Raises ConfigurationError for a rig that has none."""
        return self.role(Amplifier)

    @property
    def relay(self) -> Relay:
        """The relay. Raises ConfigurationError for a rig that has none."""
        return self.role(Relay)

    @property
    def vibrometer(self) -> Vibrometer:
        """The vibrometer. Raises ConfigurationError for a rig that has none."""
        return self.role(Vibrometer)

    @property
    def generator(self) -> Generator:
        """The generator. Raises ConfigurationError for a rig that has none."""
        return self.role(Generator)

    @property
    def player(self) -> Player:
        """The player. Raises ConfigurationError for a rig that has none."""
        return self.role(Player)

    @property
    def operator(self) -> Operator:
        """The person at the rig, or their twin."""
        return self.role(Operator)

    def motion_response(self, frequencies: FloatArray) -> ComplexArray:
        """Response from the surface's velocity to what the DAQ records of the vibrometer: see both.

        At 0 Hz the value is that at 1 Hz, as the vibrometer's.
        """
        f = np.where(frequencies == 0, 1.0, frequencies)
        return np.asarray(
            self.vibrometer.response(frequencies) * self.daq.response(self.vibrometer.channel, f)
        )

    def monitor_response(self, patch: str, frequencies: FloatArray) -> ComplexArray:
        """Response of the channel that measures the volts at a patch, as `motion_response`."""
        f = np.where(frequencies == 0, 1.0, frequencies)
        return self.daq.response(self.monitor(patch), f)

    def monitor(self, patch: str) -> str:
        """The channel that measures the volts at a patch. Raises ConfigurationError without one."""
        divider, patches = self.sensors.drive, self.table.patches
        if divider is None:
            raise ConfigurationError(
                f"The rig {self.name!r} has no [sensors.drive]; a drive is always measured, never assumed."
            )
        if len(divider.channels) == 1:
            return divider.channels[0]
        if len(divider.channels) != len(patches) or patch not in patches:
            raise ConfigurationError(
                f"[sensors.drive] of the rig {self.name!r} has {len(divider.channels)} channels, and patch "
                f"{patch!r} is looked for among {', '.join(patches)}: give one channel, or one for each "
                "patch."
            )
        return divider.channels[patches.index(patch)]

    def aim(self, point: str) -> Aim:
        """The request to bring the vibrometer to a point."""
        return Aim(point, self.vibrometer.identity if self.vibrometer.mass else "")

    def has(self, role: str) -> bool:
        """True when an instrument of this role is open."""
        return role in self._roles

    def drive_monitor(self) -> Divider:
        """The divider that measures a player's drive. Raises ConfigurationError without one."""
        drive = self.sensors.drive
        if drive is None:
            raise ConfigurationError(
                f"The rig {self.name!r} has a player and no [sensors.drive]: a player's drive must be "
                "measured, so wire it to a channel of the DAQ."
            )
        return drive

    def feeds_amplifier(self, role: Literal["daq", "player", "generator"]) -> bool:
        """True when an output of this role feeds the amplifier; of a DAQ's, those that its file names."""
        if role == "daq":
            outputs = self._file.daq.settings.get("outputs")
            return isinstance(outputs, Mapping) and self.amplifier.input in outputs
        return self.has(role) and self._roles[role].output == self.amplifier.input


# Limits of the drive at a patch, from the amplifier, the relay, the actuator and the rig file.


def ratings(rig: Instruments, patches: int) -> dict[str, Limits]:
    """Collect the limits for `patches` patches in parallel, by owner."""
    relay = Limits(min=-rig.relay.rating, max=rig.relay.rating)
    return {
        "the amplifier": rig.amplifier.limits(patches),
        "the relay": relay,
        "the actuator": rig.actuator.limits(patches),
        "the rig file's [limits]": rig.file.limits.limits(),
    }
