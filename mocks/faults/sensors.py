"""Faults of the sensors and of their cables to the cards."""

from __future__ import annotations

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.instruments.config import RigFile
from haploop.mocks.plant import Fault, FaultSettings, NotNegative, Positive, TimedFault

__all__ = ["AccelerometerInverted", "ForceCalibration", "SensorDisconnected", "SensorSaturated"]

RAIL = 15.0
"""Output of a saturated sensor (V): its supply, beyond every converter's range (estimate; docs/hardware.md,
"Limits and loss of the host")."""


class ForceCalibration(Fault):
    """The force sensor does not match the calibration matrix of the rig file."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        gain: Positive = 1.15
        """Ratio of the real sensor's output to the output that the file's matrix implies."""
        crosstalk: NotNegative = 0.05
        """Standard deviation of the crosstalk from one gauge to another."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._channels = file.sensors.force.channels if file.sensors.force else ()

    def gauges(self, gauges: FloatArray, rng: np.random.Generator) -> FloatArray:
        """See `Fault.gauges`."""
        mixing = self.settings.crosstalk * rng.standard_normal((6, 6))
        np.fill_diagonal(mixing, self.settings.gain)
        return np.asarray(mixing @ gauges)

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        """See `Fault.channel`."""
        if node in self._channels:
            self.mark(float(times[-1]))
        return volts


class AccelerometerInverted(Fault):
    """The accelerometer is mounted upside down: turned about its x axis."""

    def __init__(self, settings: FaultSettings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._channels = file.sensors.acceleration.channels if file.sensors.acceleration else ()

    def tilt(self, tilt: FloatArray) -> FloatArray:
        """See `Fault.tilt`."""
        return np.asarray(tilt * np.array([1.0, -1.0, -1.0]))

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        """See `Fault.channel`."""
        if node in self._channels:
            self.mark(float(times[-1]))
        return volts


class SensorDisconnected(Fault):
    """A channel of the DAQ is not connected and reads 0 V."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        channel: str

    settings: Settings

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        """See `Fault.channel`."""
        if node != self.settings.channel:
            return volts
        self.mark(float(times[-1]))
        return np.zeros(len(times))


class SensorSaturated(TimedFault):
    """A channel of the DAQ is driven beyond every input range."""

    class Settings(TimedFault.Settings):
        """See `FaultSettings`."""

        channel: str

    settings: Settings

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        """See `Fault.channel`."""
        if node != self.settings.channel:
            return volts
        return np.where(self.active(times), RAIL, volts)
