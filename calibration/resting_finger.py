"""A finger that rests on the table: it is asked for, weighed where a sensor can, and asked to leave.

A force sensor weighs it that carries the table (`[table] force = true`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..base.arrays import FloatArray
from ..base.errors import ConfigurationError, InstrumentError
from ..instruments.operator import LiftFinger, RestFinger

if TYPE_CHECKING:
    from ..instruments import Rig
    from ..instruments.sensors import LinearSensor

FORCES = (0.1, 20.0)
"""Forces (N) of a fingertip that rests."""

LEAST = 0.05
"""Force (N) below which nobody presses: beyond a sensor's noise and what it drifts in a minute."""
_REST = 0.2
"""Time (s) in which a sensor's rest is measured."""
_COMES = 0.5
"""Time (s) that a finger gets to come to rest, or to leave."""


def refuse_force(force: float) -> None:
    """Raise ConfigurationError for a force (N) that no fingertip rests with."""
    if not FORCES[0] <= force <= FORCES[1]:
        raise ConfigurationError(
            f"A fingertip rests with {FORCES[0]:g} to {FORCES[1]:g} N, and not with {force:.3g} N."
        )


@contextmanager
def resting(rig: Rig, asked: RestFinger) -> Iterator[None]:
    """Have a finger rest while this context lasts, however it ends.

    Raises InstrumentError when nobody does.
    """
    if not rig.operator.confirm(asked):
        raise InstrumentError(
            f"Nobody rests a finger at the {asked.point} point: {asked.participant} must be there."
        )
    try:
        rig.clock.sleep(_COMES)
        yield
    finally:
        rig.operator.confirm(LiftFinger())
        rig.clock.sleep(_COMES)


@dataclass(frozen=True, eq=False)
class TableForce:
    """The force sensor under a rig's table, with what it shows while nothing presses.

    Made anew by `at_rest` before each finger comes: a force sensor drifts.
    """

    rig: Rig
    sensor: LinearSensor
    rest: FloatArray
    """(channels,) V."""

    @classmethod
    def at_rest(cls, rig: Rig) -> TableForce | None:
        """Measure the rest of a rig's sensor, while nothing presses; None where none carries the table.

        Raises InstrumentError.
        """
        sensor = rig.sensors.force
        if not rig.table.force or sensor is None:
            return None
        return cls(rig, sensor, _volts(rig, sensor, _REST).mean(axis=1))

    def found(self, asked: RestFinger) -> float:
        """Return the force (N) of the finger that was asked for. Raises InstrumentError when none presses."""
        force = self.read()
        if force < LEAST:
            raise InstrumentError(
                f"Nobody rests a finger at the {asked.point} point: the force sensor reads {force:.2f} N, "
                f"and {asked.participant} was asked for {asked.force:g} N."
            )
        return force

    def read(self, seconds: float = _REST) -> float:
        """Return the mean force (N) in a time (s) from now on. Raises InstrumentError beyond the range."""
        volts = _volts(self.rig, self.sensor, seconds)
        if self.sensor.saturated(volts, self.rest).any():
            raise InstrumentError(
                "The force on the table is beyond the force sensor's range: press with less, and look "
                "whether anything lies on the table."
            )
        return float(self.sensor.along(volts, self.rest).mean())


def _volts(rig: Rig, sensor: LinearSensor, seconds: float) -> FloatArray:
    rate_hz = rig.file.rate_hz
    samples = max(2, round(seconds * rate_hz))
    with rig.daq.stream(sensor.channels, rate_hz, samples, samples) as stream:
        return np.asarray(stream.capture().volts)
