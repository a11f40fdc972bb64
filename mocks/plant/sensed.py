"""Sensor outputs of a scene: volts at a node, before any converter.

Each is a function of the scene rather than bound to it, so that there is no reference cycle and a dropped
plant is freed at once with its memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...instruments.arrays import FloatArray
from ...instruments.errors import HaploopError, InstrumentError
from ...instruments.sensors import low_pass
from .buttons import SimulatedPress
from .nodes import LaserHead
from .places import OnLaser, OnSensors
from .scene import GRAVITY, Scene

__all__ = ["Output", "Quantity", "Signal", "laser", "signalled", "wired"]

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
PICKUP_NOISE = {"displacement": 1e-6, "acceleration": 1e-7}
"""Noise density over the range (per sqrt(Hz); estimates; docs/hardware.md, "Other pick-ups")."""
_PRESSED = np.array([0.05, -0.03, 1.0, 0.0, 0.0, 0.0])
"""Forces (N) and torques (N m) on the sensor for each newton of a press, which is lateral too (estimate;
docs/hardware.md, "Force sensor")."""
_SHAKEN = 8
"""Number of presses whose filtered vibration is kept."""
_RING = 0.2
"""Time for which a click's vibration lasts after the finger has left (s)."""


Quantity = Callable[[Scene, FloatArray, Sequence[int], Sequence[np.random.Generator]], FloatArray]
"""Function that returns the voltages of some outputs of a sensor, (outputs, times) V, at the times of each,
(outputs, times) s, from the outputs' numbers and their generators of noise. All outputs at once take a
quarter of the time that they take one by one: a block is short, and a call of numpy is not."""


Signal = Callable[[FloatArray], FloatArray]
"""Function that returns the volts of an instrument's output, (times,) V before any converter, at rising
times, (times,) s of the plant's clock. It may be asked for the same times again, and for 30 s before them."""


@dataclass(frozen=True)
class Output:
    """An output of a sensor: what it measures, and its number among the sensor's outputs."""

    quantity: Quantity
    number: int = 0


def wired(scene: Scene) -> dict[str, Output]:
    """Return the rig file's sensors by their nodes.

    The scatter of rest, tilt and zero is an estimate (docs/hardware.md, "Force sensor", "Accelerometer").
    """
    sensors = scene.file.sensors
    nodes: dict[str, Output] = {}

    def wire(channels: Sequence[str], quantity: Quantity) -> None:
        nodes.update({node: Output(quantity, i) for i, node in enumerate(channels)})

    if sensors.force:
        matrix = np.array(sensors.force.matrix)
        # A matrix of fewer axes is a sensor that does not feel the others.
        whole = np.linalg.matrix_rank(matrix) == len(matrix)
        gauges = _loaded_gauges(scene, np.linalg.inv(matrix) if whole else np.linalg.pinv(matrix))
        rest = scene.rng("gauges").normal(0, 0.3, 6)
        # Scale the gauges' noise so that Fz, the matrix's third row, has FORCE_NOISE.
        noise = FORCE_NOISE / float(np.linalg.norm(sensors.force.matrix[2]))
        wire(sensors.force.channels, partial(_gauges, gauges=gauges, rest=rest, noise=noise))
    if sensors.acceleration:
        tilt = np.array([0.04, -0.03, 1.0])
        for fault in scene.faults.at(OnSensors):
            tilt = fault.tilt(tilt)
        zero = scene.rng("accelerometer").normal(0, 0.03, 3) * GRAVITY
        wire(sensors.acceleration.channels, partial(_axes, tilt=tilt, zero=zero))
    if sensors.activation:
        wire(sensors.activation.channels[:1], _contact)
    if sensors.drive:
        one, *more = sensors.drive.channels
        patches = scene.surface.patches
        behind = tuple(patches) if not more else scene.section.patches[:1]
        each = [behind, *((patch,) for patch, _ in zip(scene.section.patches[1:], more, strict=False))]
        wire([one, *more][: len(each)], partial(_monitors, patches=each))
    return nodes


def _loaded_gauges(scene: Scene, gauges: FloatArray) -> FloatArray:
    """Return the real sensor's sensitivity, (6, 6) V per N and N m, from that of the file's matrix."""
    for fault in scene.faults.at(OnSensors):
        gauges = fault.gauges(gauges, scene.rng("force sensor"))
    return gauges


def _gauges(
    scene: Scene,
    times: FloatArray,
    outputs: Sequence[int],
    rngs: Sequence[np.random.Generator],
    *,
    gauges: FloatArray,
    rest: FloatArray,
    noise: float,
) -> FloatArray:
    own = gauges[list(outputs)]
    weight = WEIGHT + FORCE_DRIFT * np.minimum(times, FORCE_WARM)
    if scene.loads:
        since = np.searchsorted([at for at, _ in scene.loads], times, side="right")
        weight += np.array([0.0, *(added for _, added in scene.loads)])[since]
    volts = np.empty(times.shape)
    for row, rng in enumerate(rngs):
        rng.standard_normal(out=volts[row])
    volts *= noise
    volts += rest[list(outputs), np.newaxis] + own[:, 2, np.newaxis] * weight
    volts += (own @ _PRESSED)[:, np.newaxis] * scene.force(times)
    return volts


def _axes(
    scene: Scene,
    times: FloatArray,
    outputs: Sequence[int],
    rngs: Sequence[np.random.Generator],
    *,
    tilt: FloatArray,
    zero: FloatArray,
) -> FloatArray:
    sensor = scene.file.sensors.acceleration
    assert sensor is not None
    tilted = tilt[list(outputs), np.newaxis]
    motion = tilted * GRAVITY + zero[list(outputs), np.newaxis] + np.zeros(times.shape)
    for press in scene.presses.between(times[:, 0].min(), times[:, -1].max(), _RING):
        motion += tilted * _filtered(scene, press, sensor.bandwidth_hz, times)
    density = ACCELEROMETER_NOISE * np.sqrt(np.pi / 2 * sensor.bandwidth_hz)
    noise = np.empty(motion.shape)
    for row, rng in enumerate(rngs):
        rng.standard_normal(out=noise[row])
    noise *= density
    motion += noise
    np.clip(motion, -ACCELEROMETER_CLIP, ACCELEROMETER_CLIP, out=motion)
    motion *= sensor.sensitivity
    motion += sensor.zero
    return motion


def _filtered(scene: Scene, press: SimulatedPress, pole_hz: float, times: FloatArray) -> FloatArray:
    # A press's vibration is filtered once, as a whole, by the board's pole: the axes share it, and a
    # block's first sample needs no history.
    key = (press.start, pole_hz)
    if key not in scene.shaken:
        rate_hz, lead = 50_000.0, 0.05
        # In steps of 0.1 s a length has no large prime factor, which takes ten times as long. Both ends rest.
        count = 5000 * int(np.ceil((press.stop - press.start + _RING + 2 * lead) * rate_hz / 5000))
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
    # Noise grows as the light fades: with the inverse root of its level, up to tenfold (estimate;
    # docs/hardware.md, "PDV-100").
    density = density / np.sqrt(np.maximum(level, 0.01))
    velocity += density * np.sqrt(rate_hz / 2) * rng.standard_normal(len(times))
    velocity = np.clip(velocity, -head.range, head.range)
    for fault in scene.faults.at(OnLaser):
        velocity = fault.velocity(velocity, times, head.range, rng)
    return np.asarray(velocity / head.scale + head.zero)
