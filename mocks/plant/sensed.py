"""Sensor outputs of a scene: volts at a node, before any converter.

Each is a function of the scene rather than bound to it, so that there is no reference cycle and a dropped
plant is freed at once with its memory.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.instruments.sensors import low_pass
from haploop.mocks.plant.buttons import SimulatedPress, latest
from haploop.mocks.plant.nodes import LaserHead
from haploop.mocks.plant.scene import GRAVITY, Scene

__all__ = ["Quantity", "laser", "wired"]

FORCE_NOISE = 0.03
"""Standard deviation of Fz (N), measured on a real Mini40 (found; docs/hardware.md, "Force sensor")."""
FORCE_DRIFT = 0.05 / 60
"""Drift of Fz (N/s; estimate; docs/hardware.md, "Force sensor")."""
FORCE_WARM = 3600.0
"""Warm-up time, after which the force does not drift (s; estimate; docs/hardware.md, "Force sensor")."""
WEIGHT = 4.0
"""Weight of the box on the force sensor (N; estimate; docs/hardware.md, "Force sensor")."""
ACCELEROMETER_NOISE = 300e-6 * GRAVITY
"""Noise density of the z axis, used for every axis (m/s^2 per sqrt(Hz); estimate; docs/hardware.md,
"Accelerometer")."""
ACCELEROMETER_CLIP = 3.6 * GRAVITY
"""Acceleration at which the output clips (m/s^2; docs/hardware.md, "Accelerometer")."""
CONTACT = 5.0
"""Output of the closed contact (V; it and its noise: docs/hardware.md, "Buttons and people")."""
VIBROMETER_NOISE = 0.02e-6
"""Noise density of the 20 mm/s range, used in every range (m/s per sqrt(Hz); estimate; docs/hardware.md,
"PDV-100")."""
_SHAKEN = 8
"""Number of presses whose filtered vibration is kept."""
_RING = 0.2
"""Time for which a click's vibration lasts after the finger has left (s)."""


Quantity = Callable[[Scene, FloatArray, np.random.Generator], FloatArray]
"""Function that returns a node's voltage, (times,) V, at times (s)."""


def wired(scene: Scene) -> dict[str, Quantity]:
    """Return the rig file's sensors by their nodes.

    The scatter of rest, tilt and zero is an estimate (docs/hardware.md, "Force sensor", "Accelerometer").
    """
    sensors = scene.file.sensors
    nodes: dict[str, Quantity] = {}
    if sensors.force:
        gauges = _loaded_gauges(scene, np.linalg.inv(np.array(sensors.force.matrix)))
        rest = scene.rng("gauges").normal(0, 0.3, 6)
        # Scale the gauges' noise so that Fz, the matrix's third row, has FORCE_NOISE.
        noise = FORCE_NOISE / float(np.linalg.norm(sensors.force.matrix[2]))
        for i, node in enumerate(sensors.force.channels):
            nodes[node] = partial(_gauge, row=gauges[i], rest=float(rest[i]), noise=noise)
    if sensors.acceleration:
        tilt = np.array([0.04, -0.03, 1.0])
        for fault in scene.faults:
            tilt = fault.tilt(tilt)
        zero = scene.rng("accelerometer").normal(0, 0.03, 3) * GRAVITY
        for i, node in enumerate(sensors.acceleration.channels):
            nodes[node] = partial(_axis, tilt=float(tilt[i]), zero=float(zero[i]))
    if sensors.activation:
        nodes[sensors.activation.channels[0]] = _contact
    if sensors.drive:
        one, *more = sensors.drive.channels
        patches = scene.surface.patches
        behind = tuple(patches) if not more else scene.section.patches[:1]
        nodes[one] = partial(_monitor, patches=behind)
        for patch, node in zip(scene.section.patches[1:], more, strict=False):
            nodes[node] = partial(_monitor, patches=(patch,))
    return nodes


def _loaded_gauges(scene: Scene, gauges: FloatArray) -> FloatArray:
    """Return the real sensor's sensitivity, (6, 6) V per N and N m, from that of the file's matrix."""
    for fault in scene.faults:
        gauges = fault.gauges(gauges, scene.rng("force sensor"))
    return gauges


def _gauge(
    scene: Scene, times: FloatArray, rng: np.random.Generator, *, row: FloatArray, rest: float, noise: float
) -> FloatArray:
    force = np.zeros((6, len(times)))
    force[2] = WEIGHT + FORCE_DRIFT * np.minimum(times, FORCE_WARM)
    if scene.loads:
        since = np.searchsorted([at for at, _ in scene.loads], times, side="right")
        force[2] += np.array([0.0, *(weight for _, weight in scene.loads)])[since]
    for press in latest(scene.presses, times[0], times[-1], 0.0):
        # A press also has a lateral force (estimate; docs/hardware.md, "Force sensor").
        pressed = press.force(times)
        force[0] += 0.05 * pressed
        force[1] -= 0.03 * pressed
        force[2] += pressed
    return np.asarray(rest + row @ force + noise * rng.standard_normal(len(times)))


def _axis(
    scene: Scene, times: FloatArray, rng: np.random.Generator, *, tilt: float, zero: float
) -> FloatArray:
    sensor = scene.file.sensors.acceleration
    assert sensor is not None
    motion = tilt * GRAVITY + zero + np.zeros(len(times))
    for press in latest(scene.presses, times[0], times[-1], _RING):
        motion += tilt * _filtered(scene, press, sensor.bandwidth_hz, times)
    density = ACCELEROMETER_NOISE * np.sqrt(np.pi / 2 * sensor.bandwidth_hz)
    motion += density * rng.standard_normal(len(times))
    clipped = np.clip(motion, -ACCELEROMETER_CLIP, ACCELEROMETER_CLIP)
    return np.asarray(sensor.zero + sensor.sensitivity * clipped)


def _filtered(scene: Scene, press: SimulatedPress, pole_hz: float, times: FloatArray) -> FloatArray:
    # A press's vibration is filtered once, as a whole, by the board's pole: the axes share it, and a
    # block's first sample needs no history.
    key = (press.start, pole_hz)
    if key not in scene.shaken:
        rate_hz, lead = 50_000.0, 0.05
        count = round((press.stop - press.start + _RING + 2 * lead) * rate_hz)
        grid = press.start - lead + np.arange(count) / rate_hz
        spectrum = np.fft.rfft(press.acceleration(grid))
        passed = spectrum * low_pass(
            np.asarray(np.fft.rfftfreq(count, 1 / rate_hz), dtype=np.float64), pole_hz
        )
        # Keep only the latest presses, because a study would fill the memory; older ones are recomputed.
        while len(scene.shaken) >= _SHAKEN:
            del scene.shaken[next(iter(scene.shaken))]
        scene.shaken[key] = (grid, np.fft.irfft(passed, count))
    grid, shaken = scene.shaken[key]
    return np.asarray(np.interp(times, grid, shaken, left=0.0, right=0.0))


def _contact(scene: Scene, times: FloatArray, rng: np.random.Generator) -> FloatArray:
    flips = np.sort(np.concatenate([p.flips for p in scene.presses] or [np.zeros(0)]))
    closed = np.searchsorted(flips, times, side="right") % 2
    return np.asarray(CONTACT * closed + 0.01 * rng.standard_normal(len(times)))


def _monitor(
    scene: Scene, times: FloatArray, rng: np.random.Generator, *, patches: tuple[str, ...]
) -> FloatArray:
    sensor = scene.file.sensors.drive
    assert sensor is not None
    # A divider on the bus behind the relay measures the connected patches.
    volts = [scene.patches.voltage(p, times) for p in patches]
    return np.asarray(max(volts, key=lambda v: float(np.abs(v).max())) / sensor.ratio)


def laser(scene: Scene, times: FloatArray, rng: np.random.Generator, *, head: LaserHead) -> FloatArray:
    """Return the output of a vibrometer at the point where the laser is aimed, (times,) V."""
    level = np.full(len(times), head.level)
    for fault in scene.faults:
        level = fault.light(level, times)
    velocity = scene.seen(np.asarray(times - head.delay)) * (level > 0)
    rate_hz = 1 / (times[1] - times[0]) if len(times) > 1 else 2 * head.bandwidth_hz
    density = VIBROMETER_NOISE * scene.settings.vibrometer_noise_scale
    # Noise grows as the light fades: with the inverse root of its level, up to tenfold (estimate;
    # docs/hardware.md, "PDV-100").
    density = density / np.sqrt(np.maximum(level, 0.01))
    velocity += density * np.sqrt(rate_hz / 2) * rng.standard_normal(len(times))
    velocity = np.clip(velocity, -head.range, head.range)
    for fault in scene.faults:
        velocity = fault.velocity(velocity, times, head.range, rng)
    return np.asarray(velocity / head.scale)
