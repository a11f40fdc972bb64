"""Output of a function generator, as voltage steps: pulse, channel, volatile memory."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray
from ...base.clock import Clock
from ...nidaqmx_twin.nodes import Run
from .modulation import Modulation
from .scpi import ScpiDevice, ScpiError, word_of

# Pulse of a simulated function generator: width and share of the period, of which one is held.
#
# The other follows the frequency, as both families do it.

FREQUENCY = "[:SOURce#]:FREQuency[:CW|:FIXed]"
HOLD = "[:SOURce#]:FUNCtion:PULSe:HOLD"
_WIDTH, _DUTY = "pulse width", "pulse duty"
PULSES: dict[str, tuple[float, float]] = {
    "PERiod": (33e-9, 1e6),
    "WIDTh": (16e-9, 1e6),
    "DCYCle": (0.0, 100.0),
}
"""Lowest and highest of what is set of a pulse (s, s, %)."""


def duty(channel: Channel) -> float:
    """Share of its period that a pulse is high."""
    if channel.words[HOLD] == "WIDT":
        return min(channel.values.get(_WIDTH, 100e-6) * channel.values[FREQUENCY], 1.0)
    return channel.values.get(_DUTY, 0.1)


def pulse_value(channel: Channel, name: str) -> float:
    """Return a key of `PULSES` in its unit."""
    frequency = channel.values[FREQUENCY]
    match name:
        case "PERiod":
            return 1 / frequency
        case "WIDTh":
            return duty(channel) / frequency
    return 100 * duty(channel)


def set_pulse(channel: Channel, name: str, value: float) -> None:
    """Set a key of `PULSES` in its unit."""
    if name == "PERiod":
        channel.values[FREQUENCY] = 1 / value
        return
    share = value / 100 if name == "DCYCle" else value * channel.values[FREQUENCY]
    channel.values[_DUTY] = min(share, 1.0)
    channel.values[_WIDTH] = channel.values[_DUTY] / channel.values[FREQUENCY]


def hold(channel: Channel) -> None:
    """Let what has been held go on from the pulse that is put out now, whichever is held next."""
    set_pulse(channel, "DCYCle", 100 * duty(channel))


SHAPES = ("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "ARBitrary", "DC")
_PERIOD = 20e-6
"""Step of the output (s): far above the table's band, and as fine as a DAQ's drives."""


class Points:
    """Samples of an arbitrary waveform, (points,) from -1 to 1; equal only to itself."""

    def __init__(self, values: FloatArray) -> None:
        self.values = values

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True)
class Output:
    """Settings of a channel, in volts at an open input. For PRBS and NOISe only the offset is
    simulated, because nothing here uses them.
    """

    on: bool = False
    shape: str = "SIN"
    amplitude: float = 0.0
    offset: float = 0.0
    frequency: float = 1e3
    duty: float = 0.5
    """Of a square wave or of a pulse."""
    symmetry: float = 1.0
    points: Points | None = None
    rate_hz: float = 40e3
    sweep: tuple[float, float, float] | None = None
    """Start (Hz), stop (Hz) and duration (s) of the sweep; None when it is off."""
    logarithmic: bool = False
    burst: tuple[float, float] | None = None
    """Cycles and period (s) of the burst; None when it is off."""
    burst_phase: float = 0.0
    """Where in its cycle a burst begins and waits."""
    delay: float = 0.0
    """From a trigger to the start (s)."""
    modulation: Modulation | None = None
    ends: tuple[float, float] = (-math.inf, math.inf)
    """Lowest and highest that are put out (V)."""
    repeats: bool = True
    """True when sweep or burst trigger themselves; else they wait for a trigger, the sweep at its start
    frequency."""

    def volts(self, times: FloatArray, fired: bool) -> FloatArray:
        """Return (times,) V at `times` (s) since the waveform was set or, if it has `fired`, triggered."""
        if self.burst is not None:
            return self._bursts(times, fired)
        amplitude: FloatArray | float = self.amplitude
        cycles = self._cycles(times, fired)
        if self.modulation is not None:
            amplitude, cycles = (
                amplitude * self.modulation.gain(times),
                cycles + self.modulation.cycles(times),
            )
        return np.asarray(np.clip(self.offset + amplitude * self._unit(cycles), *self.ends))

    def _bursts(self, times: FloatArray, fired: bool) -> FloatArray:
        assert self.burst is not None
        count, period = self.burst
        since = np.mod(times, period) if self.repeats else times - self.delay
        cycles = since * self._cycles_hz
        lasting = (cycles >= 0) & (cycles < count) & (fired or self.repeats)
        phases = np.where(lasting, cycles, 0.0) + self.burst_phase
        # A sine waits at the phase at which its burst begins; where other shapes wait was not found: at zero.
        resting = self.amplitude * np.sin(2 * np.pi * self.burst_phase) if self.shape == "SIN" else 0.0
        return np.asarray(self.offset + np.where(lasting, self.amplitude * self._unit(phases), resting))

    def _cycles(self, times: FloatArray, fired: bool) -> FloatArray:
        if self.sweep is None:
            return np.asarray(times * self._cycles_hz)
        start, stop, duration = self.sweep
        if not (fired or self.repeats):
            return np.asarray(times * start)
        since = np.mod(times, duration) if self.repeats else np.maximum(times - self.delay, 0.0)
        along = np.minimum(since, duration)
        if self.logarithmic:
            pace = np.log(stop / start) / duration
            swept = start * np.expm1(along * pace) / pace
        else:
            swept = along * (start + (stop - start) * along / (2 * duration))
        return np.asarray(swept + (since - along) * start)

    @property
    def _cycles_hz(self) -> float:
        return self.rate_hz / len(self.points) if self.shape == "ARB" and self.points else self.frequency

    def _unit(self, cycles: FloatArray) -> FloatArray:
        phase = np.mod(cycles, 1.0)
        match self.shape:
            case "SIN":
                return np.asarray(np.sin(2 * np.pi * phase))
            case "ARB" if self.points is not None:
                # A step of the output that falls on a point's beginning takes it, in spite of rounding.
                index = (phase * len(self.points) + 1e-6).astype(np.int64) % len(self.points)
                return self.points.values[index]
            case "SQU" | "PULS":
                return np.where(phase < self.duty, 1.0, -1.0)
            case "TRI" | "RAMP":
                top = 0.5 if self.shape == "TRI" else max(self.symmetry, 1e-9)
                return np.asarray(np.interp(phase, [0.0, top, max(1.0, top)], [-1.0, 1.0, -1.0]))
        return np.zeros(len(phase))


class Playing:
    """A `Source` that plays the waveform set last. Safe to use from any thread.

    Advance the plant to now before changing the waveform, so that it takes the old output first.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._guard = threading.Lock()
        self._waveform = Output()
        self._since = clock.now()
        self._fired = False
        self._next = 0

    def set(self, waveform: Output) -> None:
        """Put out `waveform` from now on."""
        with self._guard:
            if waveform == self._waveform:
                return
            self._waveform = waveform
            self._restart()

    def fire(self) -> None:
        """Trigger the sweep or burst now."""
        with self._guard:
            self._restart()
            self._fired = True

    def abort(self) -> None:
        """End what was fired: sweep or burst wait again."""
        with self._guard:
            if self._fired:
                self._restart()

    def take(self, until: float) -> Sequence[Run]:
        """See `haploop.nidaqmx_twin.nodes.Source.take`."""
        with self._guard:
            # The tolerance counts a step at `until` itself as past, in spite of rounding.
            past = int((until - self._since) / _PERIOD + 1e-3) + 1 if until >= self._since else 0
            if past <= self._next or (not self._waveform.on and self._next):
                return []
            first, self._next = self._next, past
            if not self._waveform.on:
                return [Run(self._since, _PERIOD, np.zeros(1))]
            times = np.arange(first, past, dtype=np.float64) * _PERIOD
            volts = self._waveform.volts(times, self._fired)
            return [Run(self._since + first * _PERIOD, _PERIOD, volts)]

    def _restart(self) -> None:
        self._since = self._clock.now()
        self._next = 0
        self._fired = False


# Settings of one channel of a simulated function generator.

_SOURCE = 50.0
"""Output impedance (ohm)."""
HIGHEST = 20.0
"""Largest amplitude without load (V peak to peak): half of it at 50 ohm."""


class Channel:
    """Settings of one channel; a reset fills them in."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}
        self.words: dict[str, str] = {}
        self.points: dict[str, Points] = {}
        self.arb = ""
        self.arriving: list[FloatArray] = []
        """Points of which more are to come."""
        self.peak_to_peak = 0.0
        """Amplitude without load (V peak to peak)."""
        self.offset = 0.0
        self.load = 50.0
        self.low, self.high = -HIGHEST / 2, HIGHEST / 2
        """Voltage limits, without load."""
        self.armed = 0
        """Triggers that it takes before it is idle, where it is not armed for ever."""

    @property
    def is_direct(self) -> bool:
        """True for direct voltage: the offset alone, whose range the amplitude does not reduce."""
        return self.words["[:SOURce#]:FUNCtion[:SHAPe]"] == "DC"

    @property
    def share(self) -> float:
        """Ratio of the voltage at the load that is set to the open-circuit voltage."""
        return 1.0 if math.isinf(self.load) else self.load / (self.load + _SOURCE)


# Volatile memory: the points of arbitrary waveforms. The DG1000Z plays what is sent to it at once.

_NAME = '"VOLATILE"'
_FULL = 16383
"""Code of the highest level (DG1000Z programming guide, 2-174)."""


def load(device: ScpiDevice, channel: Channel, full: float, swapped: bool, argument: str, most: int) -> None:
    """Take a named waveform of at most `most` points up to `full`, as the 33500 does. Raises ScpiError."""
    name, _, values = argument.partition(",")
    kind = ("<" if swapped else ">") + ("f4" if full == 1.0 else "i2")
    points = device.numbers_in(values, kind) / full
    _check(points, 8, most)
    if quoted(name) in channel.points:
        raise ScpiError(785, "Specified arb waveform already exists")
    channel.points[quoted(name)] = Points(points)


def select(channel: Channel, name: str) -> None:
    """Choose the waveform that is put out. Raises ScpiError for one that is not there."""
    if quoted(name) not in channel.points and quoted(name) != channel.arb:
        raise ScpiError(786, "Specified arb waveform does not exist")
    channel.arb = quoted(name)


def quoted(name: str) -> str:
    """Return a waveform's name as the instrument reports it: quoted and in capitals."""
    return f'"{name.strip().strip(chr(34)).upper()}"'


def receive(device: ScpiDevice, channel: Channel, kind: str, argument: str, most: int) -> bool:
    """Take points as DATA, DAC or DAC16 sends them; True with the last of them. Raises ScpiError.

    The order of the bytes was not found: the low one first (estimate).
    """
    memory, _, data = argument.partition(",")
    word_of(memory.strip(), ("VOLATILE",))
    flag = "END"
    if kind == "DAC16":
        flag, _, data = data.partition(",")
        flag = word_of(flag.strip(), ("CON", "END"))
    values = device.numbers_in(data, "<u2")
    levels = values if kind == "DATA" else values / _FULL * 2 - 1
    levels = np.concatenate([*channel.arriving, levels])
    channel.arriving.clear()
    _check(levels, 2, most)
    if flag == "CON":
        channel.arriving.append(levels)
        return False
    channel.points[_NAME] = Points(levels)
    channel.arb = _NAME
    return True


def _check(levels: FloatArray, least: int, most: int) -> None:
    if len(levels) < least:
        raise ScpiError(-109, "Missing parameter")
    if len(levels) > most:
        raise ScpiError(-223, "Too much data")
    if np.abs(levels).max() > 1.0 + 1e-6:
        raise ScpiError(-222, "Data out of range")
