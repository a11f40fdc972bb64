"""Output of a function generator, as voltage steps at a node of the plant."""

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
