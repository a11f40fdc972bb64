"""Faults of the sensors and their cables to the cards, and what machines and slow noise couple into them."""

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


_SLOWEST, _FASTEST = 0.3, 3000.0
"""Corners (Hz) between which flicker noise falls with the inverse of the frequency (estimate)."""
_PROCESSES = 8
_WANDERS = (0.07, 0.19, 0.43)
"""Frequencies (Hz) at which a machine's speed wanders (estimate)."""


class RotatingMachine(TimedFault, OnCards):
    """A machine turns nearby, a fan or a neighbour's motor: tones at multiples of one frequency.

    It runs up from rest, with an amplitude that rises with the speed, and its speed wanders slowly.
    """

    class Settings(TimedFault.Settings):
        channel: str | tuple[str, ...]
        volts: Positive = 0.01
        """Amplitude of the fundamental at full speed (V)."""
        frequency: Positive = 118.0
        """Blade or pole frequency at full speed (Hz): the fundamental."""
        harmonics: tuple[NotNegative, ...] = (0.5, 0.3, 0.2)
        """Amplitudes of the second harmonic and of those after it, relative to the fundamental."""
        run_up: NotNegative = 0.0
        """Time from rest to full speed (s)."""
        wander: NotNegative = 0.0
        """Standard deviation of the speed, relative."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._phases = rng.uniform(0, 2 * np.pi, len(settings.harmonics) + 1)
        self._wandering = rng.uniform(0, 2 * np.pi, len(_WANDERS))

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        s = self.settings
        if node not in ((s.channel,) if isinstance(s.channel, str) else s.channel):
            return volts
        running = np.maximum(times - self.begin, 0.0)
        rising = np.minimum(running, s.run_up)
        speed = rising / s.run_up if s.run_up else np.ones(len(times))
        turned = running - rising + (rising**2 / (2 * s.run_up) if s.run_up else 0.0)
        for hz, phase in zip(_WANDERS, self._wandering, strict=True):
            swing = s.wander * np.sqrt(2 / len(_WANDERS)) / (2 * np.pi * hz)
            turned = turned + swing * np.sin(2 * np.pi * hz * times + phase)
        heard = np.zeros(len(times))
        for k, (share, phase) in enumerate(zip((1.0, *s.harmonics), self._phases, strict=True), start=1):
            heard += share * np.sin(2 * np.pi * k * s.frequency * turned + phase)
        return np.asarray(volts + s.volts * self.active(times) * speed * heard)


class FlickerNoise(OnCards):
    """Noise whose power falls with the inverse of the frequency, of a contact, a drift or an old amplifier.

    A sum of first-order processes whose corners lie evenly on a logarithmic scale, of equal power each.
    """

    class Settings(FaultSettings):
        channel: str
        volts: Positive = 0.01
        """Rms (V), 0.3 Hz to 3 kHz."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._rng = rng
        self._decays = 2 * np.pi * np.geomspace(_SLOWEST, _FASTEST, _PROCESSES)
        self._states = self._rng.standard_normal(_PROCESSES)
        self._last = 0.0
        """Time (s) of the states."""

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        if node != self.settings.channel:
            return volts
        self.mark(float(times[-1]))
        period = float(times[-1] - times[0]) / max(len(times) - 1, 1)
        # As many samples passed unread as fit between two blocks; a process forgets them exponentially.
        kept = np.exp(-self._decays * max(float(times[0]) - self._last - period, 0.0))
        self._states = kept * self._states + np.sqrt(1 - kept**2) * self._rng.standard_normal(_PROCESSES)
        heard = np.zeros(len(times))
        for k, decay in enumerate(np.exp(-self._decays * period)):
            drawn = np.sqrt(1 - decay**2) * self._rng.standard_normal(len(times))
            process, _ = scipy.signal.lfilter([1.0], [1.0, -decay], drawn, zi=[decay * self._states[k]])
            heard += process
            self._states[k] = process[-1]
        self._last = float(times[-1])
        return np.asarray(volts + self.settings.volts / np.sqrt(_PROCESSES) * heard)
