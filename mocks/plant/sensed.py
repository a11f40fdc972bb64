"""Sensor outputs of a scene: volts at a node, before any converter.

Each is a function of the scene rather than bound to it, so that there is no reference cycle and a dropped
plant is freed at once with its memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import HaploopError, InstrumentError
from ...nidaqmx_twin.nodes import Signal
from .motions import Quantity, shown_by
from .places import LaserHead, OnLaser
from .scene import Scene

__all__ = ["Output", "Quantity", "laser", "signalled", "wired"]

CONTACT = 5.0
"""Output of the closed contact (V; estimate)."""
VIBROMETER_NOISE = 0.02e-6
"""Noise density of the 20 mm/s range, used in every range (m/s per sqrt(Hz); estimate; docs/hardware.md,
"PDV-100")."""
PICKUP_NOISE = {"displacement": 1e-6, "acceleration": 1e-7}
"""Noise density over the range (per sqrt(Hz); estimates)."""


@dataclass(frozen=True)
class Output:
    """An output of a sensor: what it measures, and its number among the sensor's outputs."""

    quantity: Quantity
    number: int = 0


def wired(scene: Scene) -> dict[str, Output]:
    """Return the rig file's sensors by their nodes."""
    sensors = scene.file.sensors
    nodes: dict[str, Output] = {}

    def wire(channels: Sequence[str], quantity: Quantity) -> None:
        nodes.update({node: Output(quantity, i) for i, node in enumerate(channels)})

    for sensor in sensors.linear.values():
        wire(sensor.channels, shown_by(scene, sensor))
    if sensors.activation:
        wire(sensors.activation.channels[:1], _contact)
    if sensors.drive:
        one, *more = sensors.drive.channels
        patches = scene.surface.patches
        behind = tuple(patches) if not more else scene.section.patches[:1]
        each = [behind, *((patch,) for patch, _ in zip(scene.section.patches[1:], more, strict=False))]
        wire([one, *more][: len(each)], partial(_monitors, patches=each))
    return nodes


def _contact(
    scene: Scene, times: FloatArray, outputs: Sequence[int], rngs: Sequence[np.random.Generator]
) -> FloatArray:
    closed = np.searchsorted(scene.presses.flips, times, side="right") % 2
    noise = np.array([rng.standard_normal(times.shape[1]) for rng in rngs])
    return np.asarray(CONTACT * closed + 0.01 * noise)


def _monitors(
    scene: Scene,
    times: FloatArray,
    outputs: Sequence[int],
    rngs: Sequence[np.random.Generator],
    *,
    patches: Sequence[Sequence[str]],
) -> FloatArray:
    sensor = scene.file.sensors.drive
    assert sensor is not None
    rows = []
    for output, own in zip(outputs, times, strict=True):
        # A divider on the bus behind the relay measures the connected patches.
        volts = [scene.patches.voltage(p, own) for p in patches[output]]
        rows.append(max(volts, key=lambda v: float(np.abs(v).max())) / sensor.ratio)
    return np.array(rows)


def laser(
    scene: Scene,
    times: FloatArray,
    outputs: Sequence[int],
    rngs: Sequence[np.random.Generator],
    *,
    head: LaserHead,
) -> FloatArray:
    """Return the output of a vibrometer at the point where the laser is aimed: see `Quantity`."""
    return np.array([_seen(scene, own, rng, head) for own, rng in zip(times, rngs, strict=True)])


def signalled(
    scene: Scene,
    times: FloatArray,
    outputs: Sequence[int],
    rngs: Sequence[np.random.Generator],
    *,
    signal: Signal,
) -> FloatArray:
    """Return the output of an instrument that `Plant.connect` connected: see `Quantity`."""
    volts = np.empty(times.shape)
    for row, own in zip(volts, times, strict=True):
        try:
            row[:] = _shown(signal(own), len(own))
        except HaploopError:
            raise
        except (Exception, SystemExit) as error:
            told = " ".join(f"{type(error).__name__}: {error}".split())
            name = getattr(signal, "__qualname__", type(signal).__qualname__)
            raise InstrumentError(f"The signal {name} of a twin failed ({told}): ask its author.") from error
    return volts


def _shown(volts: FloatArray, count: int) -> FloatArray:
    volts = np.asarray(volts, dtype=np.float64)
    if volts.shape != (count,) or not np.isfinite(volts).all():
        raise ValueError(f"for {count} times, volts of shape {volts.shape}, or not finite")
    return volts


def _seen(scene: Scene, times: FloatArray, rng: np.random.Generator, head: LaserHead) -> FloatArray:
    level = np.full(len(times), head.level)
    for fault in scene.faults.at(OnLaser):
        level = fault.light(level, times)
    velocity = scene.seen(np.asarray(times - head.delay)) * (level > 0)
    rate_hz = 1 / (times[1] - times[0]) if len(times) > 1 else 2 * head.bandwidth_hz
    density = head.range * PICKUP_NOISE[head.quantity] if head.quantity in PICKUP_NOISE else VIBROMETER_NOISE
    density *= scene.settings.vibrometer_noise_scale
    # Noise grows as the light fades: with the inverse root of its level, up to tenfold (estimate).
    density = density / np.sqrt(np.maximum(level, 0.01))
    velocity += density * np.sqrt(rate_hz / 2) * rng.standard_normal(len(times))
    velocity = np.clip(velocity, -head.range, head.range)
    for fault in scene.faults.at(OnLaser):
        velocity = fault.velocity(velocity, times, head.range, rng)
    return np.asarray(velocity / head.scale + head.zero)
