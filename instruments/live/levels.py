"""Levels of a live block: mean, rms and peak of each quantity in SI, for a meter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray
from ..sensors import Sensor
from ..vibrometer import UNITS
from .tap import LiveBlock, Run

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
