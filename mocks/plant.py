"""The plant: the simulated physical world of one rig, as nodes that carry a voltage.

Everything simulated touches the plant and nothing else. Nodes have the names that the rig file
gives to DAQ channels and outputs. Time is the rig's clock; the plant never runs ahead of a
question: it steps exactly as far as it is asked.
"""

from __future__ import annotations

import threading
import zlib
from bisect import insort
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from instruments.arrays import ComplexArray, FloatArray
from instruments.clock import Clock
from instruments.operator import Press
from instruments.rig_file import RigFile
from instruments.rig_file import Table as TableSection
from instruments.sensors import low_pass
from mocks.buttons import ButtonPress, Finger, button_named, latest, press_button
from mocks.nodes import Source
from mocks.table import MAIN, Table, make_plate

__all__ = ["LaserHead", "Plant", "Truth"]

GRAVITY = 9.80665
AMPLIFIER_GAIN_ERROR = 0.01
AMPLIFIER_LOW, AMPLIFIER_HIGH = -100.0, 400.0
FORCE_NOISE = 0.03
"""N sd of Fz: measured on a real Mini40 (found; hardware.md, section 6)."""
FORCE_DRIFT = 0.05 / 60
"""N/s (estimate; hardware.md, section 13)."""
WEIGHT = 4.0
"""N: the box on the force sensor (estimate)."""
ACCELEROMETER_NOISE = 300e-6 * GRAVITY
"""m/s^2 per sqrt(Hz) of the z axis (estimate; hardware.md, section 7)."""
ACCELEROMETER_CLIP = 3.6 * GRAVITY
CONTACT = 5.0
"""V across a closed contact."""
VIBROMETER_NOISE = 0.02e-6
"""m/s per sqrt(Hz) of the 20 mm/s range (estimate; hardware.md, section 5a)."""
_RING = 0.2
"""Seconds for which a click can be felt after the finger has left."""


@dataclass
class LaserHead:
    """The optics and the decoder of a vibrometer as they really are, whatever a rig file says."""

    range: float
    """Full scale (m/s): the output clips there."""
    sensitivity: float
    """m/s per V at the output."""
    bandwidth_hz: float
    delay: float
    """Seconds by which the output is late."""
    level: float = 1.0
    """Share of the light that comes back, 0 to 1; without light there is only noise."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What only a simulator can know: for tests and reports, never for an estimator."""

    _plant: Plant

    @property
    def presses(self) -> tuple[ButtonPress, ...]:
        """Every press so far, in order."""
        return tuple(self._plant.presses)

    @property
    def resonance_hz(self) -> float:
        """Natural frequency of the mode near 263.5 Hz."""
        return float(self._plant.table.plate.natural_hz[MAIN])

    def velocity_response(self, patch: str, point: str, frequencies: FloatArray) -> ComplexArray:
        """(frequencies,) m/s per V at the patch, hysteresis left out."""
        return self._plant.table.plate.velocity(patch, self._plant.place(point), frequencies)

    @property
    def patch_voltages(self) -> dict[str, float]:
        """Voltage across each patch now."""
        plant = self._plant
        now = np.array([plant.clock.now()])
        plant.advance(now[0])
        return {p: float(plant.table.voltage(p, now)[0]) for p in plant.table.plate.patches}

    @property
    def closed(self) -> frozenset[str]:
        """Patches whose contacts are closed now."""
        self._plant.advance(self._plant.clock.now())
        return frozenset(self._plant.closed)

    @property
    def peak(self) -> float:
        """Largest voltage (V) that any patch has been driven with so far."""
        return self._plant.peak


class Plant:
    """See the module. A laser looks at the table once a vibrometer's twin has installed its head."""

    def __init__(self, file: RigFile, clock: Clock) -> None:
        self.clock = clock
        self.settings = file.simulation
        self.presses: list[ButtonPress] = []
        self.closed: set[str] = set()
        self.peak = 0.0
        self._file = file
        self._section = file.table or TableSection(
            button_point=20, patch_capacitance=90e-9, patch_low=-100, patch_high=400
        )
        self._lock = threading.RLock()
        self._aim = "button"
        self._switched: list[tuple[float, int, str, bool]] = []
        self._callbacks: list[Callable[[float], None]] = []
        self._source: Source | None = None
        self._now = clock.now()
        self._input = 0.0
        s = self.settings
        self.table = Table(
            make_plate(
                self.rng("table"),
                s.mode_drift,
                s.damping_scale,
                self.place("button") if s.collocated else None,
            ),
            s.hysteresis,
        )
        self._gain = 50.0 * (1 + AMPLIFIER_GAIN_ERROR * self.rng("amplifier").uniform(-1, 1))
        self._nodes = self._named_nodes()
        self._shaken: dict[tuple[float, float], tuple[FloatArray, FloatArray]] = {}
        self._noise = {node: self.rng(f"noise of {node}") for node in self._nodes}

    def rng(self, name: str) -> np.random.Generator:
        """The generator of one part of the plant: parts do not disturb each other's chance."""
        return np.random.default_rng([self.settings.seed, zlib.crc32(name.encode())])

    @property
    def truth(self) -> Truth:
        """See `Truth`."""
        return Truth(self)

    def place(self, point: str) -> tuple[float, float]:
        """Where a point of the table lies, as fractions of its width and height."""
        index = self._section.button_point if point == "button" else int(point)
        row, column = divmod(index, self._section.columns)
        return (column + 0.5) / self._section.columns, (row + 0.5) / self._section.rows

    # What people and instruments do to the plant

    def install(self, node: str, head: LaserHead) -> None:
        """Put a vibrometer in place, its output wired to `node`."""
        self.table.laser_pole_hz = head.bandwidth_hz
        self._nodes[node] = partial(self._laser, head)
        self._noise[node] = self.rng(f"noise of {node}")

    def press(self, request: Press) -> None:
        """A participant presses a button, after their reaction time from now."""
        with self._lock:
            finger = Finger.of(self.rng(f"finger of {request.participant}"))
            rng = self.rng(f"{request.participant} presses {request.button}, {request.number}")
            wait = finger.reaction * float(rng.uniform(0.8, 1.25))
            start = self.clock.now() + wait
            press = press_button(button_named(request.button), finger, request.participant, start, rng)
            self.presses.append(press)

    def aim(self, point: str) -> None:
        """Aim the laser at a point of the table."""
        with self._lock:
            self.place(point)
            self._aim = point

    def switch(self, patch: str, closed: bool, at: float) -> None:
        """A relay contact changes at `at` (s), which does not lie before the latest question."""
        with self._lock:
            insort(self._switched, (max(at, self._now), len(self._switched), patch, closed))

    def every(self, callback: Callable[[float], None]) -> None:
        """Call `callback(until)` before the plant steps to `until` (s)."""
        self._callbacks.append(callback)

    def drive(self, node: str, source: Source) -> None:
        """See `mocks.nodes.Nodes.drive`. Only the amplifier's input reaches anything."""
        with self._lock:
            self.advance(self.clock.now())
            device = self._file.amplifier
            if device is not None and device.settings.get("input") == node:
                self._source = source

    # What converters ask of it

    def read(self, node: str, times: FloatArray) -> FloatArray:
        """See `mocks.nodes.Nodes.read`. A node that nothing is wired to carries zero volts."""
        with self._lock:
            if not len(times):
                return np.zeros(0)
            self.advance(float(times[-1]))
            quantity = self._nodes.get(node)
            return quantity(times, self._noise[node]) if quantity else np.zeros(len(times))

    def advance(self, until: float) -> None:
        """Step to `until` (s), contacts and output steps in order of time."""
        with self._lock:
            if until <= self._now:
                return
            for callback in self._callbacks:
                callback(until)
            while self._switched and self._switched[0][0] <= until:
                at, _, patch, closed = self._switched.pop(0)
                self._step_to(at)
                self.closed ^= {patch} if closed is not (patch in self.closed) else set()
                self._feed(at, np.inf, np.array([self._input]))
            self._step_to(until)

    def _step_to(self, until: float) -> None:
        if self._source is not None:
            for run in self._source.take(until):
                if len(run.values):
                    self._feed(run.start, run.period, self._amplified(run.values))
        self._now = max(self._now, until)

    def _amplified(self, volts: FloatArray) -> FloatArray:
        return np.asarray(np.clip(volts * self._gain, AMPLIFIER_LOW, AMPLIFIER_HIGH))

    def _feed(self, start: float, period: float, volts: FloatArray) -> None:
        self._input = float(volts[-1])
        open_circuit = np.zeros(len(volts))
        patches = self.table.plate.patches
        self.table.step(start, period, {p: volts if p in self.closed else open_circuit for p in patches})
        if self.closed:
            self.peak = max(self.peak, float(np.abs(volts).max()))

    # Nodes

    def _named_nodes(self) -> dict[str, Callable[[FloatArray, np.random.Generator], FloatArray]]:
        sensors = self._file.sensors
        nodes: dict[str, Callable[[FloatArray, np.random.Generator], FloatArray]] = {}
        if sensors.force:
            gauges = np.linalg.inv(np.array(sensors.force.matrix))
            rest = self.rng("gauges").normal(0, 0.3, 6)
            # Fz is the sum of the gauges' noise through the matrix's third row.
            noise = FORCE_NOISE / float(np.linalg.norm(sensors.force.matrix[2]))
            for i, node in enumerate(sensors.force.channels):
                nodes[node] = partial(self._gauge, gauges[i], float(rest[i]), noise)
        if sensors.acceleration:
            tilt = np.array([0.04, -0.03, 1.0])
            zero = self.rng("accelerometer").normal(0, 0.03, 3) * GRAVITY
            for i, node in enumerate(sensors.acceleration.channels):
                nodes[node] = partial(self._axis, float(tilt[i]), float(zero[i]))
        if sensors.activation:
            nodes[sensors.activation.channels[0]] = self._contact
        if sensors.drive:
            nodes[sensors.drive.channels[0]] = self._monitor
        return nodes

    def _gauge(
        self, row: FloatArray, rest: float, noise: float, times: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        force = np.zeros((6, len(times)))
        force[2] = WEIGHT + FORCE_DRIFT * times
        for press in latest(self.presses, times[0], times[-1], 0.0):
            pressed = press.force(times)
            force[0] += 0.05 * pressed
            force[1] -= 0.03 * pressed
            force[2] += pressed
        return np.asarray(rest + row @ force + noise * rng.standard_normal(len(times)))

    def _axis(self, tilt: float, zero: float, times: FloatArray, rng: np.random.Generator) -> FloatArray:
        sensor = self._file.sensors.acceleration
        assert sensor is not None
        motion = tilt * GRAVITY + zero + np.zeros(len(times))
        for press in latest(self.presses, times[0], times[-1], _RING):
            motion += tilt * self._filtered(press, sensor.bandwidth_hz, times)
        density = ACCELEROMETER_NOISE * np.sqrt(np.pi / 2 * sensor.bandwidth_hz)
        motion += density * rng.standard_normal(len(times))
        clipped = np.clip(motion, -ACCELEROMETER_CLIP, ACCELEROMETER_CLIP)
        return np.asarray(sensor.zero + sensor.sensitivity * clipped)

    def _filtered(self, press: ButtonPress, pole_hz: float, times: FloatArray) -> FloatArray:
        # A press is shaken once, as a whole, through the board's pole: the axes share it, and a
        # block's first sample needs no history.
        key = (press.start, pole_hz)
        if key not in self._shaken:
            rate_hz, lead = 50_000.0, 0.05
            count = round((press.stop - press.start + _RING + 2 * lead) * rate_hz)
            grid = press.start - lead + np.arange(count) / rate_hz
            spectrum = np.fft.rfft(press.acceleration(grid))
            passed = spectrum * low_pass(
                np.asarray(np.fft.rfftfreq(count, 1 / rate_hz), dtype=np.float64), pole_hz
            )
            self._shaken[key] = (grid, np.fft.irfft(passed, count))
        grid, shaken = self._shaken[key]
        return np.asarray(np.interp(times, grid, shaken, left=0.0, right=0.0))

    def _contact(self, times: FloatArray, rng: np.random.Generator) -> FloatArray:
        flips = np.sort(np.concatenate([p.flips for p in self.presses] or [np.zeros(0)]))
        closed = np.searchsorted(flips, times, side="right") % 2
        return np.asarray(CONTACT * closed + 0.01 * rng.standard_normal(len(times)))

    def _monitor(self, times: FloatArray, rng: np.random.Generator) -> FloatArray:
        sensor = self._file.sensors.drive
        assert sensor is not None
        # The divider hangs on the bus behind the relay: it sees whichever patches are connected.
        volts = [self.table.voltage(p, times) for p in self.table.plate.patches]
        return np.asarray(max(volts, key=lambda v: float(np.abs(v).max())) / sensor.ratio)

    def _laser(self, head: LaserHead, times: FloatArray, rng: np.random.Generator) -> FloatArray:
        velocity = self.table.velocity(self.place(self._aim), times - head.delay) * (head.level > 0)
        rate_hz = 1 / (times[1] - times[0]) if len(times) > 1 else 2 * head.bandwidth_hz
        density = VIBROMETER_NOISE * self.settings.vibrometer_noise_scale
        # Noise grows as the light fades (an estimate: with the root of its share, and tenfold at most).
        density /= np.sqrt(max(head.level, 0.01))
        velocity += density * np.sqrt(rate_hz / 2) * rng.standard_normal(len(times))
        return np.asarray(np.clip(velocity, -head.range, head.range) / head.sensitivity)
