"""Faults of the sensors and of their cables to the cards."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import scipy
from pydantic import Field

from ...base.arrays import FloatArray
from ...base.bounded import NotNegative, Positive
from ...instruments.config import RigFile
from ..plant import FaultSettings, OnCards, OnSensors, TimedFault

RAIL = 15.0
"""Output of a saturated sensor (V): its supply, beyond every converter's range (estimate)."""


class ForceCalibration(OnSensors, OnCards):
    """The force sensor does not match the calibration matrix of the rig file."""

    class Settings(FaultSettings):
        gain: Positive = 1.15
        """Ratio of the real sensor's output to the output that the file's matrix implies."""
        crosstalk: NotNegative = 0.05
        """Standard deviation of the crosstalk from one gauge to another."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._channels = file.sensors.force.channels if file.sensors.force else ()

    def gauges(self, gauges: FloatArray, rng: np.random.Generator) -> FloatArray:
        mixing = self.settings.crosstalk * rng.standard_normal((len(gauges), len(gauges)))
        np.fill_diagonal(mixing, self.settings.gain)
        return np.asarray(mixing @ gauges)

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        if node in self._channels:
            self.mark(float(times[-1]))
        return volts


class AccelerometerInverted(OnSensors, OnCards):
    """The accelerometer is mounted upside down: turned about its x axis."""

    def __init__(self, settings: FaultSettings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._channels = file.sensors.acceleration.channels if file.sensors.acceleration else ()

    def tilt(self, tilt: FloatArray) -> FloatArray:
        return np.asarray(tilt * np.array([1.0, -1.0, -1.0]))

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        if node in self._channels:
            self.mark(float(times[-1]))
        return volts


class SensorDisconnected(OnCards):
    """A channel of the DAQ is not connected and reads 0 V."""

    class Settings(FaultSettings):
        channel: str

    settings: Settings

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        if node != self.settings.channel:
            return volts
        self.mark(float(times[-1]))
        return np.zeros(len(times))


class SensorSaturated(TimedFault, OnCards):
    """A channel of the DAQ is driven beyond every input range."""

    class Settings(TimedFault.Settings):
        channel: str

    settings: Settings

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        if node != self.settings.channel:
            return volts
        return np.where(self.active(times), RAIL, volts)


class MainsHum(TimedFault, OnCards):
    """The mains couple into channels of the DAQ: the laser's, the gauges'."""

    class Settings(TimedFault.Settings):
        channel: str | tuple[str, ...]
        volts: Positive = 0.01
        """Amplitude of the fundamental (V)."""
        frequency: Positive = 50.0
        """Frequency of the mains (Hz)."""
        harmonics: tuple[NotNegative, ...] = (0.1, 0.3, 0.05, 0.15)
        """Amplitudes of the second harmonic and of those after it, relative to the fundamental."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._phases = rng.uniform(0, 2 * np.pi, len(settings.harmonics) + 1)

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        s = self.settings
        if node not in ((s.channel,) if isinstance(s.channel, str) else s.channel):
            return volts
        hum = np.zeros(len(times))
        for k, (share, phase) in enumerate(zip((1.0, *s.harmonics), self._phases, strict=True), start=1):
            hum += share * np.sin(2 * np.pi * k * s.frequency * times + phase)
        return np.asarray(volts + s.volts * self.active(times) * hum)


class SensorCreep(OnCards):
    """A sensor creeps: after a load it goes on rising for a while, and after its end it comes back as late.

    To each channel, the mean of five low-passes of its own signal, whose time constants lie evenly on a
    logarithmic scale, is added: about logarithmic in time between the shortest and the longest of them.
    """

    class Settings(FaultSettings):
        channel: str | tuple[str, ...]
        share: Annotated[float, Field(strict=True, gt=0, le=0.5)] = 0.03
        """Creep of a constant load in the end, relative to the load."""
        shortest: Positive = 0.1
        longest: Positive = 100.0
        """Time constants (s)."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._rates = 1 / np.geomspace(settings.shortest, settings.longest, 5)
        self._known: dict[str, tuple[float, float, float, FloatArray]] = {}
        """Of each channel: volts at rest; time, volts and states at the last sample."""

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        s = self.settings
        if node not in ((s.channel,) if isinstance(s.channel, str) else s.channel):
            return volts
        self.mark(float(times[-1]))
        rest, time, last, states = self._known.get(
            node, (float(volts[0]), float(times[0]), float(volts[0]), np.zeros(len(self._rates)))
        )
        # Between two blocks, the load is taken to be that of the last sample.
        states = last - rest + (states - (last - rest)) * np.exp(-self._rates * max(times[0] - time, 0.0))
        period = float(times[-1] - times[0]) / max(len(times) - 1, 1)
        crept = np.zeros(len(volts))
        for k, rate in enumerate(self._rates):
            decay = np.exp(-rate * period)
            low, _ = scipy.signal.lfilter([0.0, 1 - decay], [1.0, -decay], volts - rest, zi=[states[k]])
            crept += low / len(self._rates)
            states[k] = low[-1]
        self._known[node] = (rest, float(times[-1]), float(volts[-1]), states)
        return np.asarray(volts + s.share * crept)
