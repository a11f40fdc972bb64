"""Taps: the blocks of a running recording or play, and their levels, for a viewer that cannot slow it down.

A callback would run the viewer's code in the thread that reads or writes samples, so a tap is a bounded
inbox: publishing puts a reference in and returns.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ...base.arrays import BoolArray, FloatArray
from ...base.clock import Clock, RealClock
from ...base.threads import Closing, Inbox
from ..daq import Block
from ..sensors import Sensor, Sensors
from ..vibrometer import UNITS, Quantity

Array = TypeVar("Array", FloatArray, BoolArray)


@dataclass(frozen=True)
class Run:
    """Properties common to the blocks of one recording or play."""

    rig: str
    simulated: bool
    doing: str
    """"record", "play" or "look"."""
    about: str
    """Path of the recording, the patches that are played, or empty."""
    channels: tuple[str, ...]
    rate_hz: float
    sensors: Sensors
    """Sensors of the rig, which turn volts of `channels` into SI."""
    laser: tuple[str, float, Quantity] | None
    """Channel of the vibrometer, its scale (SI per V), and what it shows."""
    number: int = 0
    """Number of the recording or play since the rig was opened, from 1."""


@dataclass(frozen=True, eq=False)
class LiveBlock:
    """Consecutive samples of a run: (channels, samples) V, read-only, and (channels,) overload flags.

    `first` is the index of the first sample since the run began. A dropped block leaves a gap in the indices.
    """

    run: Run
    first: int
    volts: FloatArray
    overload: BoolArray

    @property
    def end(self) -> int:
        """Index of the sample that follows this block."""
        return self.first + int(self.volts.shape[1])


class Tap(Closing):
    """Queue of the newest blocks, at most `capacity`. When it is full, a new block replaces the oldest.

    One thread takes blocks; make a tap for each viewer. Time-outs count on `clock`. A context, whose exit
    closes the tap.
    """

    def __init__(
        self, capacity: int = 16, clock: Clock | None = None, on_close: Callable[[], None] = lambda: None
    ) -> None:
        if capacity < 1:
            raise ValueError(f"A tap holds 1 block or more, not {capacity}.")
        self._inbox: Inbox[LiveBlock] = Inbox(capacity)
        self._clock = clock or RealClock()
        self._on_close = on_close
        self._offered = self._taken = 0
        self._error: Exception | None = None

    @property
    def dropped(self) -> int:
        """Number of blocks that were replaced or skipped before they were taken."""
        return max(0, self._offered - self._taken - len(self._inbox))

    @property
    def closed(self) -> bool:
        """True when no further block will come; waiting ones can still be taken."""
        return self._inbox.ended

    def offer(self, block: LiveBlock, missed: int = 0) -> None:
        """Add a block; `missed` others before it were dropped elsewhere. Never waits."""
        # Counted after it is in: for a moment, `dropped` may be one too low, but never too high.
        self._inbox.put(block)
        self._offered += 1 + missed

    def take(self, timeout: float | None = None) -> LiveBlock | None:
        """Take the oldest waiting block; None after `timeout` seconds without one, or when the tap is closed.

        Without `timeout`, wait until the tap is closed. Raises the error that the tap was closed with.
        """
        until = None if timeout is None else self._clock.now() + timeout
        while True:
            left = math.inf if until is None else until - self._clock.now()
            if self._inbox.wait(max(left, 0.0)):
                self._taken += 1
                return self._inbox.take()
            if self._inbox.ended and self._error is not None:
                raise self._error
            if self._inbox.ended or left <= 0:
                return None

    def latest(self) -> LiveBlock | None:
        """Take the newest block without waiting, and drop older ones; None without a new block."""
        newest = None
        for _ in range(len(self._inbox)):
            newest = self._inbox.take()
        if newest is not None:
            self._taken += 1
        elif self._inbox.ended and self._error is not None:
            raise self._error
        return newest

    def __iter__(self) -> Iterator[LiveBlock]:
        """Yield each block that is not dropped, until the tap is closed."""
        while (block := self.take()) is not None:
            yield block

    def close(self, error: Exception | None = None) -> None:
        """Accept no further blocks; `error` is raised to the viewer after it has taken the waiting ones."""
        if not self._inbox.ended:
            self._error = error
            self._inbox.end()
            self._on_close()


class Feed:
    """Hands the blocks of each run on a rig to the rig's taps. Without a tap it does nothing."""

    def __init__(self) -> None:
        # Replaced as a whole, so that publishing needs no lock.
        self._taps: tuple[Tap, ...] = ()
        self._changing = threading.Lock()
        self._runs = 0
        self._closed = False

    @property
    def tapped(self) -> int:
        """Number of taps."""
        return len(self._taps)

    def tap(self, capacity: int = 16) -> Tap:
        """Return a new tap on all further blocks; a closed one once the feed is closed."""
        tap = Tap(capacity, on_close=lambda: self._remove(tap))
        with self._changing:
            self._taps = (*self._taps, tap)
        if self._closed:
            tap.close()
        return tap

    def begin(self, run: Run) -> Callable[[Block], None]:
        """Begin a run. Returns the function that publishes each of its blocks, and never waits."""
        self._runs += 1
        run = replace(run, number=self._runs)

        def publish(block: Block) -> None:
            if not self._taps:
                return
            live = LiveBlock(run, block.first, _read_only(block.volts), _read_only(block.overload))
            for tap in self._taps:
                tap.offer(live)

        return publish

    def close(self) -> None:
        """Close every tap. May be called again."""
        self._closed = True
        for tap in self._taps:
            tap.close()

    def _remove(self, tap: Tap) -> None:
        with self._changing:
            self._taps = tuple(other for other in self._taps if other is not tap)


def _read_only(values: Array) -> Array:
    """Return a read-only view, so that no viewer can change the values of others."""
    view: Array = values.view()
    view.flags.writeable = False
    return view


# Levels of a live block: mean, rms and peak of each quantity in SI, for a meter.

Quantities = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], FloatArray]
"""Names, units, channels and (quantities, samples) values."""


@dataclass(frozen=True)
class Level:
    """Levels of one quantity within one block.

    `rms` is about `mean`, and `peak` is the largest distance from it, so that neither contains a sensor's
    offset: a force sensor's gauges, for one, are not zeroed in a live block.
    """

    name: str
    unit: str
    mean: float
    rms: float
    peak: float
    overload: bool
    """True when a channel that it is computed from was at the end of its range."""


def levels(block: LiveBlock) -> tuple[Level, ...]:
    """Compute the levels of all quantities of sensors and laser, then of the other channels, in volts."""
    found = []
    run = block.run
    contact = run.sensors.activation.channels if run.sensors.activation else ()
    for names, units, channels, values in signals(run, block.volts):
        # A contact has two states and no range.
        ranged = [run.channels.index(channel) for channel in channels if channel not in contact]
        overload = bool(block.overload[ranged].any())
        found += [
            _level(name, unit, row, overload) for name, unit, row in zip(names, units, values, strict=True)
        ]
    return tuple(found)


def signals(run: Run, volts: FloatArray) -> list[Quantities]:
    """As `quantities`, and then the channels without a sensor, in volts."""
    found = quantities(run, volts)
    used = {channel for _, _, channels, _ in found for channel in channels}
    rest = [row for row, channel in enumerate(run.channels) if channel not in used]
    return found + [((run.channels[row],), ("V",), (run.channels[row],), volts[[row]]) for row in rest]


def quantities(run: Run, volts: FloatArray) -> list[Quantities]:
    """Names, units, channels and (quantities, samples) SI values of each completely streamed sensor.

    `volts` is (channels, samples) of the run's channels; a channel without a sensor is left out.
    """
    found: list[Quantities] = []
    for _, sensor in run.sensors:
        if isinstance(sensor, Sensor) and set(sensor.channels) <= set(run.channels):
            names, units = zip(*sensor.labels, strict=True)
            rows = [run.channels.index(channel) for channel in sensor.channels]
            found.append((names, units, sensor.channels, sensor.to_si(volts[rows])))
    for name, extra in run.sensors.extra.items():
        if extra.channel in run.channels:
            row = volts[[run.channels.index(extra.channel)]]
            found.append(((extra.name or name,), (extra.unit,), (extra.channel,), extra.to_si(row)))
    if run.laser is not None and run.laser[0] in run.channels:
        channel, scale, quantity = run.laser
        row = volts[[run.channels.index(channel)]]
        found.append(((quantity,), (UNITS[quantity],), (channel,), scale * row))
    return found


def _level(name: str, unit: str, values: FloatArray, overload: bool) -> Level:
    if not values.size:
        return Level(name, unit, 0.0, 0.0, 0.0, overload)
    mean = float(values.mean())
    moved = values - mean
    return Level(name, unit, mean, float(np.sqrt(np.mean(moved**2))), float(np.abs(moved).max()), overload)
