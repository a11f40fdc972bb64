"""Signals at the terminals of simulated cards: what a test sets, and what a program has put out."""

from __future__ import annotations

import threading
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from ..base.arrays import FloatArray
from ..base.clock import Clock
from ..base.errors import ConfigurationError
from .nodes import Run, SamplesLost, Signal, Source

__all__ = ["Put", "Signal", "Signals", "Wire", "signal_of"]

_SETTLED = 20.0
"""Time constants of a low-pass after which what came before no longer shows (2e-9)."""


@dataclass(frozen=True, eq=False)
class Put:
    """What an output has put out: value k is held from `times[k]` until the next."""

    times: FloatArray
    """Times of the steps, (steps,) s since the twin was made."""
    values: FloatArray
    """(steps,) V, or 0 and 1 of a digital line."""

    def at(self, times: FloatArray | float) -> FloatArray:
        """Return the values at `times` (s, of any shape); 0 before the first step."""
        index = np.searchsorted(self.times, np.asarray(times) + 1e-9, side="right")
        return np.asarray(np.concatenate([[0.0], self.values])[index])


@dataclass(frozen=True)
class Wire:
    """A wire from an output to an input, and what is in its way. SI units."""

    gain: float = 1.0
    offset: float = 0.0
    """Added after the gain (V)."""
    delay: float = 0.0
    low_pass_hz: float | None = None
    """Corner of a first-order low-pass, or None."""
    noise: float = 0.0
    """White noise of each sample (V rms)."""

    def signal(self, put: Callable[[], Put], seed: int) -> Signal:
        """Return what arrives of the output that `put` reads."""

        def arrives(times: FloatArray) -> FloatArray:
            values = self.gain * self._passed(put(), times - self.delay) + self.offset
            if self.noise:
                drawn = np.random.default_rng([seed, abs(round(float(times[0]) * 1e9))])
                values = values + self.noise * drawn.standard_normal(len(times))
            return values

        return arrives

    def _passed(self, put: Put, times: FloatArray) -> FloatArray:
        if self.low_pass_hz is None:
            return put.at(times)
        tau = 1 / (2 * np.pi * self.low_pass_hz)
        first = int(np.searchsorted(put.times, times[0] - _SETTLED * tau))
        steps, held = put.times[first:], put.values[first:]
        before = float(put.values[first - 1]) if first else 0.0
        # Exact at the steps, one after the other, and from there to each sample.
        reached, states = before, np.empty(len(steps) + 1)
        target, since = before, float(steps[0]) if len(steps) else 0.0
        states[0] = before
        for k, (step, value) in enumerate(zip(steps, held, strict=True)):
            reached = target + (reached - target) * np.exp(-(step - since) / tau)
            states[k + 1], target, since = reached, value, step
        index = np.searchsorted(steps, times, side="right")
        targets = np.concatenate([[before], held])[index]
        began = np.concatenate([[-np.inf], steps])[index]
        return np.asarray(targets + (states[index] - targets) * np.exp(-(times - began) / tau))


def signal_of(
    value: float | Sequence[float] | FloatArray | Signal | str | Path,
    rate_hz: float | None,
    repeat: bool,
    start: float,
) -> Signal:
    """Return the signal that a number, samples, a function or a file (.npy, .csv, .wav) describes.

    Samples begin at `start` (s) and are held for 1 / `rate_hz`, the last one until the end unless they
    `repeat`. A .csv has one number in a line; a .wav brings its rate, and its full scale is 1 V. Raises
    ConfigurationError.
    """
    if callable(value):
        return value
    if isinstance(value, str | Path):
        samples, rate_hz = _from_file(Path(value), rate_hz)
    else:
        samples = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if samples.ndim != 1 or not len(samples) or not np.isfinite(samples).all():
        raise ConfigurationError("A signal is a number, or a row of finite numbers (samples,).")
    if len(samples) == 1:
        return lambda times: np.full(len(times), samples[0])
    if not rate_hz or rate_hz <= 0:
        raise ConfigurationError("A signal of several samples needs its rate: rate_hz=1000.")
    rate = rate_hz

    def sampled(times: FloatArray) -> FloatArray:
        index = np.floor((times - start) * rate + 1e-6).astype(np.int64)
        index = index % len(samples) if repeat else np.clip(index, 0, len(samples) - 1)
        return np.asarray(samples[index])

    return sampled


def _from_file(path: Path, rate_hz: float | None) -> tuple[FloatArray, float | None]:
    try:
        if path.suffix == ".npy":
            return np.load(path).astype(np.float64), rate_hz
        if path.suffix == ".csv":
            return np.loadtxt(path, delimiter=",", ndmin=1, dtype=np.float64), rate_hz
        if path.suffix == ".wav":
            rate, samples = scipy.io.wavfile.read(path)
            scale = np.iinfo(samples.dtype).max if samples.dtype.kind == "i" else 1.0
            return np.asarray(samples / scale, dtype=np.float64), float(rate)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"The signal {path} cannot be read: {error}.") from None
    raise ConfigurationError(f"The signal {path} is none of .npy, .csv and .wav.")


class Signals:
    """The nodes of terminals that a test sets: see `nodes.Nodes`. Any thread may call it."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self._lock = threading.RLock()
        self._signals: dict[str, Signal] = {}
        self._sources: dict[str, Source] = {}
        self._runs: dict[str, list[Run]] = {}
        self._lost: dict[str, SamplesLost] = {}

    def set(self, node: str, signal: Signal) -> None:
        """Let `node` carry `signal` from now on."""
        with self._lock:
            self._signals[node] = signal

    def lose(self, device: str, lost: SamplesLost) -> None:
        """Let the next samples of `device` be lost."""
        with self._lock:
            self._lost[device] = lost

    def put(self, node: str) -> Put:
        """Return what has been put out at `node` until now."""
        with self._lock:
            runs = self._runs.setdefault(node, [])
            if node in self._sources:
                runs += self._sources[node].take(self.clock.now())
            times = [run.times for run in runs if np.isfinite(run.start)]
            values = [run.values for run in runs if np.isfinite(run.start)]
        return Put(np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros(0), *values]))

    def wire(self, output: str, input_: str, wire: Wire) -> None:
        """Connect an output to an input."""
        self.set(input_, wire.signal(lambda: self.put(output), zlib.crc32(input_.encode())))

    def forget(self) -> None:
        """Forget what was put out until now; what is held stays."""
        with self._lock:
            for node in self._sources:
                self.put(node)
                self._runs[node] = self._runs[node][-1:]

    # What `Nodes` asks

    def read(self, nodes: Sequence[str], times: FloatArray) -> FloatArray:
        """See `Nodes.read`."""
        with self._lock:
            for node in nodes:
                if (lost := self._lost.pop(node.partition("/")[0], None)) is not None:
                    raise lost
            signals: Mapping[str, Signal] = dict(self._signals)
        rows = [
            np.broadcast_to(signals[node](row), row.shape) for node, row in zip(nodes, times, strict=True)
        ]
        return np.array(rows, dtype=np.float64)

    def plays(self, device: str) -> None:
        """See `Nodes.plays`: no play ends here before its time."""

    def drive(self, node: str, source: Source) -> None:
        """See `Nodes.drive`."""
        with self._lock:
            self._sources[node] = source
