"""Sensor outputs of a scene: volts at a node, before any converter.

Each is a function of the scene rather than bound to it, so that there is no reference cycle and a dropped
plant is freed at once with its memory.

Model of what linear sensors show of a press (force, acceleration, velocity and travel of the cap): a finger
moves the cap along a path, and each snap sheds an acceleration into it. The cap's travel is the path, less
the clicks integrated twice; the integrals leak at `_HELD_HZ`: the finger holds the cap.
A sensor shows its quantity through its declared response: poles, zeros and a measured response by FFT over
the whole press; the high-pass corners of an AC-coupled one by their recursion, whose tail goes on after the
press. Estimates: noise, offsets, tilt, and what the finger holds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import HaploopError, InstrumentError
from ...instruments.sensors import LinearSensor
from ...nidaqmx_twin.nodes import Signal
from .buttons import SimulatedPress
from .places import LaserHead, OnLaser, OnSensors
from .scene import GRAVITY, Scene

FORCE_NOISE = 0.03
"""Standard deviation of Fz (N), measured on a real Mini40 (found; docs/hardware.md, "Force sensor")."""
CELL_NOISE = 0.01
"""Standard deviation of a force sensor of one to three axes (N; estimate)."""
FORCE_DRIFT = 0.05 / 60
"""Drift of Fz (N/s; estimate)."""
FORCE_WARM = 3600.0
"""Warm-up time, after which the force does not drift (s; estimate)."""
WEIGHT = 4.0
"""Weight of the box on the force sensor (N; estimate)."""
ACCELEROMETER_NOISE = 300e-6 * GRAVITY
"""Noise density of the z axis of a DC-coupled one, used for every axis (m/s^2 per sqrt(Hz); estimate;
docs/hardware.md, "Accelerometer")."""
PIEZO_NOISE = 300e-6 * GRAVITY
"""Standard deviation of an AC-coupled accelerometer (m/s^2; estimate)."""
CLIPS = 1.2
"""Value at which a sensor clips over its range: 3.6 g of 3 g (docs/hardware.md, "Accelerometer")."""
TRAVEL_NOISE = 0.2e-6
"""Standard deviation of a displacement (m; estimate)."""
VELOCITY_NOISE = 1e-6
"""Standard deviation of a velocity of the cap (m/s; estimate)."""
OFFSETS = {"force": 0.3, "displacement": 1e-4, "velocity": 0.0}
"""Standard deviation of a sensor's own offset, in SI (estimates)."""
_LATERAL = {"x": 0.05, "y": -0.03}
"""Lateral force (N) for each newton of a press; there is no torque (estimate)."""
_HELD_HZ = 5.0
"""Corner below which a click does not move the cap, because the finger holds it (estimate)."""
_OWN_HZ, _WIDEST_HZ = 550.0, 1600.0
"""Hz: what a DC-coupled accelerometer passes on z without a stated low-pass, and at most: an ADXL335's own
limits on z, and on x and y (docs/hardware.md, "Accelerometer")."""
_SHAKEN = 8
"""Number of presses whose filtered signals are kept."""
_RING = 0.2
"""Time for which a click's vibration lasts after the finger has left (s)."""
_GRID_HZ = 50_000.0
_FADED = 7.0
"""Time constants after which what an AC-coupled sensor shows of a press has faded."""

Quantity = Callable[[Scene, FloatArray, Sequence[int], Sequence[np.random.Generator]], FloatArray]
"""Function that returns the voltages of some outputs of a sensor, (outputs, times) V, at the times of each,
(outputs, times) s, from the outputs' numbers and their generators of noise. All outputs at once take a
quarter of the time that they take one by one: a block is short, and a call of numpy is not."""


def shown_by(scene: Scene, sensor: LinearSensor) -> Quantity:
    """Return what a sensor shows, as volts of its channels."""
    own = _inverse(sensor)
    if sensor.measures == "force":
        for fault in scene.faults.at(OnSensors):
            own = fault.gauges(own, scene.rng("force sensor"))
        return partial(_forces, sensor=sensor, own=own, rest=_rest(scene, sensor, own))
    if sensor.measures == "acceleration":
        tilt = np.array([0.04, -0.03, 1.0])
        for fault in scene.faults.at(OnSensors):
            tilt = fault.tilt(tilt)
        coupled = 0.0 if sensor.ac_coupled else 1.0
        zero = coupled * scene.rng("accelerometer").normal(0, 0.03, len(sensor.axes)) * GRAVITY
        shares = _on_axes(sensor, tilt)
        still = zero + shares * GRAVITY * sensor.gravity
        return partial(_moved, sensor=sensor, own=own, shares=shares, still=still)
    shares = _on_axes(sensor, np.array([0.0, 0.0, 1.0]))
    still = scene.rng(sensor.measures).normal(0, OFFSETS[sensor.measures], len(sensor.axes))
    return partial(_moved, sensor=sensor, own=own, shares=shares, still=still * (not sensor.ac_coupled))


def _inverse(sensor: LinearSensor) -> FloatArray:
    """(channels, axes) V per SI of the sensor that the file's matrix describes."""
    matrix = np.array(sensor.matrix)
    if np.count_nonzero(matrix - np.diag(np.diagonal(matrix))) == 0 and len(matrix) == len(matrix.T):
        return np.diag(1 / np.diagonal(matrix))
    return np.asarray(np.linalg.inv(matrix) if len(matrix) == len(matrix.T) else np.linalg.pinv(matrix))


def _rest(scene: Scene, sensor: LinearSensor, own: FloatArray) -> FloatArray:
    """(channels,) V that a force sensor shows unloaded."""
    zero = np.array(sensor.zero)
    if len(sensor.channels) > 3:
        return zero + scene.rng("gauges").normal(0, 0.3, len(sensor.channels))
    offsets = scene.rng("gauges").normal(0, OFFSETS["force"], len(sensor.axes))
    return zero + own @ offsets * (not sensor.ac_coupled)


def _on_axes(sensor: LinearSensor, vector: FloatArray) -> FloatArray:
    """What a vector (level, level, vertical) has along the sensor's axes; torques have nothing."""
    found = np.zeros(len(sensor.axes))
    level = iter(vector[:2])
    for number, axis in enumerate(sensor.axes):
        if number == sensor.row:
            found[number] = sensor.sign * vector[2]
        elif not axis.startswith("r"):
            found[number] = next(level)
    return found


def _forces(
    scene: Scene,
    times: FloatArray,
    outputs: Sequence[int],
    rngs: Sequence[np.random.Generator],
    *,
    sensor: LinearSensor,
    own: FloatArray,
    rest: FloatArray,
) -> FloatArray:
    own = own[list(outputs)]
    volts = np.empty(times.shape)
    for row, rng in enumerate(rngs):
        rng.standard_normal(out=volts[row])
    # Scale the channels' noise so that the vertical force has its own.
    wide = FORCE_NOISE if len(sensor.channels) > 3 else CELL_NOISE
    volts *= wide / float(np.linalg.norm(sensor.weights))
    upright = _on_axes(sensor, np.array([0.0, 0.0, 1.0]))
    volts += rest[list(outputs), np.newaxis] + (own @ upright)[:, np.newaxis] * _weight(scene, sensor, times)
    pressed = _on_axes(sensor, np.array([_LATERAL["x"], _LATERAL["y"], 1.0]))
    volts += (own @ pressed)[:, np.newaxis] * _seen(scene, sensor, times)
    if scene.section.force:
        # A hand's force changes slowly, beside the sensor's response.
        volts += (own @ upright)[:, np.newaxis] * scene.pressed(times)
    return _clipped(sensor, volts)


def _weight(scene: Scene, sensor: LinearSensor, times: FloatArray) -> FloatArray:
    """Weight on a force sensor with its drift (N); of an AC-coupled one, what has not faded."""
    corners = sensor.transfer.high_pass_hz
    weight = np.zeros(times.shape)
    levels = np.array([0.0, *(added for _, added in scene.loads)])
    if corners:
        for (at, after), before in zip(scene.loads, levels[:-1], strict=True):
            since = times - at
            weight += (since >= 0) * (after - before) * np.exp(-2 * np.pi * corners[0] * np.maximum(since, 0))
        return weight
    weight += WEIGHT + FORCE_DRIFT * np.minimum(times, FORCE_WARM)
    if scene.loads:
        number = np.searchsorted([at for at, _ in scene.loads], times, side="right")
        weight += levels[number]
    return weight


def _moved(
    scene: Scene,
    times: FloatArray,
    outputs: Sequence[int],
    rngs: Sequence[np.random.Generator],
    *,
    sensor: LinearSensor,
    own: FloatArray,
    shares: FloatArray,
    still: FloatArray,
) -> FloatArray:
    # A channel is an axis: motion sensors have no other matrix.
    rows = list(outputs)
    motion = still[rows, np.newaxis] + shares[rows, np.newaxis] * _seen(scene, sensor, times)
    noise = np.empty(motion.shape)
    for row, rng in enumerate(rngs):
        rng.standard_normal(out=noise[row])
    motion += _noise(sensor) * noise
    if sensor.range is not None:
        most = CLIPS * np.array(sensor.range)[rows, np.newaxis]
        np.clip(motion, -most, most, out=motion)
    motion *= np.diagonal(own)[rows, np.newaxis]
    motion += np.array(sensor.zero)[rows, np.newaxis]
    return _clipped(sensor, motion)


def _noise(sensor: LinearSensor) -> float:
    """Standard deviation of a motion sensor's noise, in SI."""
    if sensor.measures == "displacement":
        return TRAVEL_NOISE
    if sensor.measures == "velocity":
        return VELOCITY_NOISE
    if sensor.ac_coupled:
        return PIEZO_NOISE
    passes = sensor.bandwidth_hz if np.isfinite(sensor.bandwidth_hz) else _OWN_HZ
    return float(ACCELEROMETER_NOISE * np.sqrt(np.pi / 2 * min(passes, _WIDEST_HZ)))


def _clipped(sensor: LinearSensor, volts: FloatArray) -> FloatArray:
    return volts if sensor.output is None else np.clip(volts, -sensor.output, sensor.output)


def _seen(scene: Scene, sensor: LinearSensor, times: FloatArray) -> FloatArray:
    """What a sensor shows of all presses behind its response, in SI, at times of any shape."""
    transfer = sensor.transfer
    if sensor.measures == "force" and transfer == type(transfer)():
        return scene.force(times)
    seen = np.zeros(times.shape)
    if not times.size:
        return seen
    times = times - transfer.delay
    corners = transfer.high_pass_hz
    tail = _RING + (_FADED / (2 * np.pi * min(corners)) if corners else 0.0)
    for press in scene.presses.between(float(times.min()), float(times.max()), tail):
        grid, passed = _filtered(scene, press, sensor)
        part = np.interp(times, grid, passed, left=0.0, right=0.0)
        if corners:
            late = times > grid[-1]
            part[late] = passed[-1] * np.exp(-2 * np.pi * min(corners) * (times[late] - grid[-1]))
        seen += part
    return seen


def _filtered(scene: Scene, press: SimulatedPress, sensor: LinearSensor) -> tuple[FloatArray, FloatArray]:
    # A press is filtered once, as a whole: the axes share it, and a block's first sample needs no history.
    key = (press.start, sensor.measures)
    if key not in scene.shaken:
        lead = 0.05
        # In steps of 0.1 s a length has no large prime factor, which takes ten times as long. Both ends rest.
        count = 5000 * int(np.ceil((press.stop - press.start + _RING + 2 * lead) * _GRID_HZ / 5000))
        grid = press.start - lead + np.arange(count) / _GRID_HZ
        f = np.asarray(np.fft.rfftfreq(count, 1 / _GRID_HZ), dtype=np.float64)
        passed = np.fft.irfft(_spectrum(press, sensor, grid, f) * sensor.transfer.fast(f), count)
        for corner in sensor.transfer.high_pass_hz:
            passed = _without_constant(passed, corner)
        # Keep only the latest presses, because a study would fill the memory; older ones are recomputed.
        while len(scene.shaken) >= _SHAKEN * len(scene.file.sensors.linear):
            del scene.shaken[next(iter(scene.shaken))]
        scene.shaken[key] = (grid, np.asarray(passed))
    return scene.shaken[key]


def _spectrum(press: SimulatedPress, sensor: LinearSensor, grid: FloatArray, f: FloatArray) -> ComplexArray:
    """Spectrum of what a press does along what a sensor measures; travel is positive downwards."""
    if sensor.measures == "force":
        return np.asarray(np.fft.rfft(press.force(grid)))
    if sensor.measures == "acceleration":
        return np.asarray(np.fft.rfft(press.acceleration(grid)))
    travel, clicks = np.fft.rfft(press.travel(grid)), np.fft.rfft(press.clicks(grid))
    integrated = clicks / (2j * np.pi * f + 2 * np.pi * _HELD_HZ)
    if sensor.measures == "velocity":
        return np.asarray(integrated - 2j * np.pi * f * travel)
    return np.asarray(travel - integrated / (2j * np.pi * f + 2 * np.pi * _HELD_HZ))


def _without_constant(signal: FloatArray, corner_hz: float) -> FloatArray:
    """A high-pass of first order, by the bilinear transform, from rest."""
    k = np.pi * corner_hz / _GRID_HZ
    return np.asarray(scipy.signal.lfilter([1 / (1 + k), -1 / (1 + k)], [1.0, -(1 - k) / (1 + k)], signal))


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
    return np.array([_velocity(scene, own, rng, head) for own, rng in zip(times, rngs, strict=True)])


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


def _velocity(scene: Scene, times: FloatArray, rng: np.random.Generator, head: LaserHead) -> FloatArray:
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
