"""What the sensors show of a plant: volts at a node, before any converter.

Each is a function of the plant, not bound to it: a plant that nobody has any more is gone at once, with
all that it remembers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.instruments.sensors import low_pass
from haploop.mocks.faults import AccelerometerInverted, ForceCalibration, LaserBlocked, LaserDropout
from haploop.mocks.plant.buttons import SimulatedPress, latest

if TYPE_CHECKING:
    from haploop.mocks.plant.plant import Plant

__all__ = ["GRAVITY", "LaserHead", "Quantity", "laser", "wired"]

GRAVITY = 9.80665
FORCE_NOISE = 0.03
"""N sd of Fz: measured on a real Mini40 (found; docs/hardware.md, "Force sensor")."""
FORCE_DRIFT = 0.05 / 60
"""N/s (estimate; docs/hardware.md, "Force sensor")."""
FORCE_WARM = 3600.0
"""Seconds after which the sensor is warm and drifts no further (estimate)."""
WEIGHT = 4.0
"""N: the box on the force sensor (estimate)."""
ACCELEROMETER_NOISE = 300e-6 * GRAVITY
"""m/s^2 per sqrt(Hz) of the z axis (estimate; docs/hardware.md, "Accelerometer")."""
ACCELEROMETER_CLIP = 3.6 * GRAVITY
CONTACT = 5.0
"""V across a closed contact."""
VIBROMETER_NOISE = 0.02e-6
"""m/s per sqrt(Hz) of the 20 mm/s range (estimate; docs/hardware.md, "PDV-100")."""
_SHAKEN = 8
"""Presses whose filtered vibration is kept."""
_RING = 0.2
"""Seconds for which a click can be felt after the finger has left."""


@dataclass
class LaserHead:
    """The optics and the decoder of a vibrometer as they really are, whatever a rig file says."""

    range: float
    """Full scale (m/s): the output clips there."""
    scale: float
    """m/s per V at the output."""
    bandwidth_hz: float
    delay: float
    """Seconds by which the output is late."""
    level: float = 1.0
    """Share of the light that comes back, 0 to 1; without light there is only noise."""


Quantity = Callable[["Plant", FloatArray, np.random.Generator], FloatArray]
"""What a node carries at (times,) s."""


def wired(plant: Plant) -> dict[str, Quantity]:
    """By node, the sensors that the rig file names."""
    sensors = plant.file.sensors
    nodes: dict[str, Quantity] = {}
    if sensors.force:
        gauges = _loaded_gauges(plant, np.linalg.inv(np.array(sensors.force.matrix)))
        rest = plant.rng("gauges").normal(0, 0.3, 6)
        # Fz is the sum of the gauges' noise through the matrix's third row.
        noise = FORCE_NOISE / float(np.linalg.norm(sensors.force.matrix[2]))
        for i, node in enumerate(sensors.force.channels):
            nodes[node] = partial(_gauge, row=gauges[i], rest=float(rest[i]), noise=noise)
    if sensors.acceleration:
        tilt = np.array([0.04, -0.03, 1.0])
        if plant.faults.of(AccelerometerInverted):
            tilt[1:] *= -1
        zero = plant.rng("accelerometer").normal(0, 0.03, 3) * GRAVITY
        for i, node in enumerate(sensors.acceleration.channels):
            nodes[node] = partial(_axis, tilt=float(tilt[i]), zero=float(zero[i]))
    if sensors.activation:
        nodes[sensors.activation.channels[0]] = _contact
    if sensors.drive:
        one, *more = sensors.drive.channels
        patches = plant.table.plate.patches
        behind = tuple(patches) if not more else plant.section.patches[:1]
        nodes[one] = partial(_monitor, patches=behind)
        for patch, node in zip(plant.section.patches[1:], more, strict=False):
            nodes[node] = partial(_monitor, patches=(patch,))
    return nodes


def _loaded_gauges(plant: Plant, gauges: FloatArray) -> FloatArray:
    """(6, 6) V per N and N m of the sensor that is really there, from what the file's matrix says."""
    for fault in plant.faults.of(ForceCalibration):
        mixing = fault.settings.crosstalk * plant.rng("force sensor").standard_normal((6, 6))
        np.fill_diagonal(mixing, fault.settings.gain)
        gauges = mixing @ gauges
    return np.asarray(gauges)


def _gauge(
    plant: Plant, times: FloatArray, rng: np.random.Generator, *, row: FloatArray, rest: float, noise: float
) -> FloatArray:
    force = np.zeros((6, len(times)))
    force[2] = WEIGHT + FORCE_DRIFT * np.minimum(times, FORCE_WARM)
    if plant.loads:
        since = np.searchsorted([at for at, _ in plant.loads], times, side="right")
        force[2] += np.array([0.0, *(weight for _, weight in plant.loads)])[since]
    for fault in plant.faults.of(ForceCalibration):
        fault.mark(float(times[-1]))
    for press in latest(plant.presses, times[0], times[-1], 0.0):
        pressed = press.force(times)
        force[0] += 0.05 * pressed
        force[1] -= 0.03 * pressed
        force[2] += pressed
    return np.asarray(rest + row @ force + noise * rng.standard_normal(len(times)))


def _axis(
    plant: Plant, times: FloatArray, rng: np.random.Generator, *, tilt: float, zero: float
) -> FloatArray:
    sensor = plant.file.sensors.acceleration
    assert sensor is not None
    for fault in plant.faults.of(AccelerometerInverted):
        fault.mark(float(times[-1]))
    motion = tilt * GRAVITY + zero + np.zeros(len(times))
    for press in latest(plant.presses, times[0], times[-1], _RING):
        motion += tilt * _filtered(plant, press, sensor.bandwidth_hz, times)
    density = ACCELEROMETER_NOISE * np.sqrt(np.pi / 2 * sensor.bandwidth_hz)
    motion += density * rng.standard_normal(len(times))
    clipped = np.clip(motion, -ACCELEROMETER_CLIP, ACCELEROMETER_CLIP)
    return np.asarray(sensor.zero + sensor.sensitivity * clipped)


def _filtered(plant: Plant, press: SimulatedPress, pole_hz: float, times: FloatArray) -> FloatArray:
    # A press is shaken once, as a whole, through the board's pole: the axes share it, and a
    # block's first sample needs no history.
    key = (press.start, pole_hz)
    if key not in plant.shaken:
        rate_hz, lead = 50_000.0, 0.05
        count = round((press.stop - press.start + _RING + 2 * lead) * rate_hz)
        grid = press.start - lead + np.arange(count) / rate_hz
        spectrum = np.fft.rfft(press.acceleration(grid))
        passed = spectrum * low_pass(
            np.asarray(np.fft.rfftfreq(count, 1 / rate_hz), dtype=np.float64), pole_hz
        )
        # Whoever asks for what is long past has it made again; a study would fill the memory.
        while len(plant.shaken) >= _SHAKEN:
            del plant.shaken[next(iter(plant.shaken))]
        plant.shaken[key] = (grid, np.fft.irfft(passed, count))
    grid, shaken = plant.shaken[key]
    return np.asarray(np.interp(times, grid, shaken, left=0.0, right=0.0))


def _contact(plant: Plant, times: FloatArray, rng: np.random.Generator) -> FloatArray:
    flips = np.sort(np.concatenate([p.flips for p in plant.presses] or [np.zeros(0)]))
    closed = np.searchsorted(flips, times, side="right") % 2
    return np.asarray(CONTACT * closed + 0.01 * rng.standard_normal(len(times)))


def _monitor(
    plant: Plant, times: FloatArray, rng: np.random.Generator, *, patches: tuple[str, ...]
) -> FloatArray:
    sensor = plant.file.sensors.drive
    assert sensor is not None
    # A divider on the bus behind the relay sees whichever patches are connected.
    volts = [plant.table.voltage(p, times) for p in patches]
    return np.asarray(max(volts, key=lambda v: float(np.abs(v).max())) / sensor.ratio)


def laser(plant: Plant, times: FloatArray, rng: np.random.Generator, *, head: LaserHead) -> FloatArray:
    """What a vibrometer puts out that looks where the laser is aimed."""
    level = np.full(len(times), head.level)
    for blocked in plant.faults.of(LaserBlocked):
        level[blocked.active(times)] = 0.0
    velocity = plant.table.velocity(plant.place(plant.aimed), times - head.delay) * (level > 0)
    rate_hz = 1 / (times[1] - times[0]) if len(times) > 1 else 2 * head.bandwidth_hz
    density = VIBROMETER_NOISE * plant.settings.vibrometer_noise_scale
    # Noise grows as the light fades (an estimate: with the root of its share, and tenfold at most).
    density = density / np.sqrt(np.maximum(level, 0.01))
    velocity += density * np.sqrt(rate_hz / 2) * rng.standard_normal(len(times))
    velocity = np.clip(velocity, -head.range, head.range)
    for dropout in plant.faults.of(LaserDropout):
        lost = dropout.active(times)
        velocity[lost] = 1.2 * head.range * rng.choice([-1.0, 1.0], int(lost.sum()))
    return np.asarray(velocity / head.scale)
