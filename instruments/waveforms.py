"""Waveforms of a generator: values that state what a limiter has to know before they are set.

Volts are at the patch for a rig, and at its load for a generator. A package may add a kind: a value with the
members of `Waveform`, and a driver that plays it. The limiter judges its samples and what it states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from ..base.arrays import FloatArray
from ..base.errors import ConfigurationError
from .limits import sounding

_FINE = 64
"""Samples per period of a sine: they find its extremes to 0.2 %."""


_EDGE_HZ = 50e3
"""Lowest rate at which a staircase is judged: an edge of a slow one is no slower."""


_MOST = 64e6
"""Largest number of samples that is judged: half a gigabyte."""


class Waveform(Protocol):
    """What a generator plays once after its trigger; `str()` describes it without its volts."""

    @property
    def amplitude(self) -> float:
        """Largest magnitude (V)."""

    @property
    def duration(self) -> float:
        """Time from the trigger to the end (s)."""

    @property
    def duty(self) -> float:
        """Fraction of the duration from the first volts to the last."""

    @property
    def goes_on(self) -> bool:
        """True when the output goes on after the end until it is switched off; else it stays at 0 V."""

    def sampled(self, rest: float) -> tuple[FloatArray, float]:
        """Return (samples,) V from the trigger on, and their rate (Hz): finely enough to find the extremes.

        They reach to the end or, if it goes on, to `rest` seconds after it.
        """

    def scaled(self, factor: float) -> Self:
        """Return the same waveform with its volts multiplied by `factor`."""


@dataclass(frozen=True)
class Sweep:
    """One linear sine sweep. Raises ConfigurationError for one that no generator can play."""

    start_hz: float
    """Start frequency, above zero: no generator starts at 0 Hz (estimate;
    the paper's sweep is 0 to 625 Hz)."""
    stop_hz: float
    duration: float
    """Seconds from start to stop."""
    amplitude: float
    """V peak."""

    def __post_init__(self) -> None:
        values = (self.start_hz, self.stop_hz, self.duration, self.amplitude)
        if not all(math.isfinite(v) and v > 0 for v in values) or self.stop_hz <= self.start_hz:
            raise ConfigurationError(
                f"A sweep from {self.start_hz:g} to {self.stop_hz:g} Hz in {self.duration:g} s at "
                f"{self.amplitude:g} V cannot be played: it must rise from above 0 Hz, last, and have volts."
            )
        _refuse_endless(self, _FINE * self.stop_hz * self.duration)

    def __str__(self) -> str:
        return f"sweep of {self.start_hz:g} to {self.stop_hz:g} Hz in {self.duration:g} s"

    @property
    def duty(self) -> float:
        """See `Waveform.duty`."""
        return 1.0

    @property
    def goes_on(self) -> bool:
        """See `Waveform.goes_on`: at the start frequency."""
        return True

    def sampled(self, rest: float) -> tuple[FloatArray, float]:
        """See `Waveform.sampled`."""
        rate_hz = _FINE * self.stop_hz
        times = np.arange(round((self.duration + rest) * rate_hz)) / rate_hz
        along = np.minimum(times, self.duration)
        pace = (self.stop_hz - self.start_hz) / self.duration
        cycles = (self.start_hz + pace * along / 2) * along + self.start_hz * (times - along)
        return self.amplitude * np.sin(2 * np.pi * cycles), rate_hz

    def scaled(self, factor: float) -> Self:
        """See `Waveform.scaled`."""
        return replace(self, amplitude=factor * self.amplitude)


@dataclass(frozen=True)
class Burst:
    """Whole cycles of a sine that begin and end at 0 V. Raises ConfigurationError if it cannot be played."""

    frequency_hz: float
    cycles: int
    amplitude: float
    """V peak."""

    def __post_init__(self) -> None:
        values = (self.frequency_hz, self.amplitude, self.cycles)
        if not all(math.isfinite(v) and v > 0 for v in values) or self.cycles != int(self.cycles):
            raise ConfigurationError(
                f"A burst of {self.cycles:g} cycles of {self.frequency_hz:g} Hz at {self.amplitude:g} V "
                "cannot be played: give whole cycles, a frequency above 0 Hz, and volts."
            )
        _refuse_endless(self, _FINE * self.cycles)

    def __str__(self) -> str:
        return f"burst of {self.cycles:g} cycles of {self.frequency_hz:g} Hz"

    @property
    def duration(self) -> float:
        """See `Waveform.duration`."""
        return self.cycles / self.frequency_hz

    @property
    def duty(self) -> float:
        """See `Waveform.duty`."""
        return 1.0

    @property
    def goes_on(self) -> bool:
        """See `Waveform.goes_on`."""
        return False

    def sampled(self, rest: float) -> tuple[FloatArray, float]:
        """See `Waveform.sampled`."""
        cycle = np.sin(2 * np.pi * np.arange(_FINE) / _FINE)
        volts = self.amplitude * np.append(np.tile(cycle, int(self.cycles)), 0.0)
        return volts, _FINE * self.frequency_hz

    def scaled(self, factor: float) -> Self:
        """See `Waveform.scaled`."""
        return replace(self, amplitude=factor * self.amplitude)


@dataclass(frozen=True)
class Arbitrary:
    """Samples (V), each held for a period of `rate_hz`. Raises ConfigurationError if it cannot be played."""

    volts: Sequence[float] | FloatArray
    """Any sequence or array; kept as a tuple. Begins and ends at 0 V, where a generator stays."""
    rate_hz: float

    def __post_init__(self) -> None:
        volts = np.asarray(self.volts, dtype=np.float64)
        if volts.ndim != 1 or len(volts) < 3 or not np.isfinite(volts).all() or not volts.any():
            raise ConfigurationError(
                "An arbitrary waveform is one row of three samples or more, finite and not all 0 V."
            )
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ConfigurationError(f"An arbitrary waveform cannot be played at {self.rate_hz:g} samples/s.")
        if volts[0] != 0 or volts[-1] != 0:
            raise ConfigurationError(
                f"An arbitrary waveform begins and ends at 0 V, and this one at {volts[0]:g} and "
                f"{volts[-1]:g} V: the generator stays there before and after it."
            )
        object.__setattr__(self, "volts", tuple(map(float, volts)))
        _refuse_endless(self, len(volts) * max(1.0, _EDGE_HZ / self.rate_hz))

    def __repr__(self) -> str:
        return f"<Arbitrary: {self}, {self.amplitude:g} V>"

    def __str__(self) -> str:
        return f"arbitrary waveform of {len(self.volts)} samples at {self.rate_hz:g} Hz"

    @property
    def amplitude(self) -> float:
        """See `Waveform.amplitude`."""
        return float(np.abs(self.volts).max())

    @property
    def duration(self) -> float:
        """See `Waveform.duration`."""
        return len(self.volts) / self.rate_hz

    @property
    def duty(self) -> float:
        """See `Waveform.duty`."""
        first, stop = sounding(np.array(self.volts))
        return (stop - first) / len(self.volts)

    @property
    def goes_on(self) -> bool:
        """See `Waveform.goes_on`."""
        return False

    def sampled(self, rest: float) -> tuple[FloatArray, float]:
        """See `Waveform.sampled`."""
        held = math.ceil(max(1.0, _EDGE_HZ / self.rate_hz))
        return np.repeat(np.array(self.volts), held), held * self.rate_hz

    def scaled(self, factor: float) -> Self:
        """See `Waveform.scaled`."""
        return replace(self, volts=factor * np.array(self.volts))


def _refuse_endless(waveform: Waveform, samples: float) -> None:
    if samples > _MOST:
        raise ConfigurationError(
            f"A {waveform} is too long to be judged sample by sample: {samples:.3g} samples of {_MOST:.3g}."
        )
