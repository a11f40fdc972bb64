"""State of a simulated table and of what people do to it, which the sensors read, and `Truth` for tests."""

from __future__ import annotations

import threading
import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.clock import Clock
from ...instruments.config import RigFile
from ...instruments.operator import Press, RestFinger, Touch
from .buttons import FLAWS, Finger, Flaw, Presses, SimulatedPress, button_named, press_button
from .hysteresis import PatchLaw
from .kinds import Faults, asked, plant_source, surface_and_laws
from .places import LaserHead, OnLaser, OnSurface
from .poles import Course, Poles
from .surface import AMPLIFIER_POLE_HZ, REMEMBERED, Contact, PlantSource, Surface, place_of, table_of
from .touches import Fingertip, Hand, SimulatedTouch, skin_of, touch_surface


class Patches:
    """The actuators of all patches of a surface, at rest at zero volts."""

    def __init__(self, laws: Mapping[str, PatchLaw], amplifier_pole_hz: float = AMPLIFIER_POLE_HZ) -> None:
        self._laws = dict(laws)
        pole = 2 * np.pi * amplifier_pole_hz
        count = len(self._laws)
        self._poles = Poles(np.full(count, -pole, dtype=np.complex128), np.eye(count))
        self._weights = dict(zip(self._laws, pole * np.eye(count, dtype=np.complex128), strict=True))
        self._course: Course[Mapping[str, ComplexArray]] = Course(self._weights, self._poles, REMEMBERED)
        self._driven: set[str] = set()
        """Patches that have carried another voltage than zero."""

    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Apply the amplifier's output at each patch, (steps,) V, as `Surface.step`; return linear volts."""
        levels = np.array([volts[patch] for patch in self._laws])
        self._driven.update(patch for patch, own in zip(self._laws, levels, strict=True) if own.any())
        self._course.step(self._weights, self._poles, start, period, levels)
        return {patch: law.follow(volts[patch]) for patch, law in self._laws.items()}

    def voltage(self, patch: str, times: FloatArray) -> FloatArray:
        """Return the voltage across a patch, (times,) V, at rising times (s)."""
        if patch not in self._driven:
            return np.zeros(len(times))
        return self._course.seen(times, lambda weights: weights[patch])


GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)
class AmplifierOutput:
    """A section of the amplifier's output: value k is held from `start + k * period` (s) until the next one.

    `volts` is (samples,) V, applied to the patches whose contacts are `closed`.
    """

    start: float
    period: float
    volts: FloatArray
    closed: frozenset[str]


class Scene(ABC):
    """The table of one rig, the fingers and weights on it, and the aim of the laser.

    A scene is static; the plant implements `advance`, which steps it through time.
    """

    def __init__(self, file: RigFile, clock: Clock, source: PlantSource | None = None) -> None:
        self.file = file
        self.clock = clock
        self.settings = file.simulation
        self.section = table_of(file)
        self.faults = Faults.of_file(file)
        self.presses = Presses()
        self.touches: list[SimulatedTouch] = []
        self.target = 0.0
        """Area (m^2) of the round target that lies on the touch surface, for the camera; 0 without one."""
        self.loads: list[tuple[float, float]] = []
        """Additional weights on the force sensor: the time from which each applies (s), and its force (N)."""
        self.hands: list[Hand] = []
        """What rests, has rested or will rest on the table."""
        self._resting: dict[Hand, tuple[Contact, ...]] = {}
        self.aimed = "button"
        self.closed: set[str] = set(self.section.patches) if file.wiring == "direct" else set()
        """Patches whose contacts are closed; of a rig without a relay, always all."""
        self.peak = 0.0
        """Largest voltage magnitude applied to any patch (V)."""
        self.amplifier_record: list[AmplifierOutput] | None = None
        self.shaken: dict[tuple[float, str], tuple[FloatArray, FloatArray]] = {}
        """What sensors show of presses, kept for their next block."""
        self._lock = threading.RLock()
        self._heads: list[tuple[LaserHead, LaserHead]] = []
        source = source or plant_source(file)
        self.surface, laws = surface_and_laws(file, source, self.faults.at(OnSurface), self.rng("table"))
        told = file.amplifier.settings.get("bandwidth_hz") if file.amplifier else None
        self.surface.amplifier_pole_hz = float(told or AMPLIFIER_POLE_HZ)
        self.surface.coil_pole_hz = file.actuator.pole_hz if file.actuator else None
        self.patches = Patches(laws, self.surface.amplifier_pole_hz)
        for fault in self.faults.at(OnSurface):
            self.hands += fault.hands()
        if self.hands:
            # A surface that knows no bodies refuses them here, and not in the middle of a play.
            self.surface.touched(())

    @abstractmethod
    def advance(self, until: float) -> None:
        """Step the scene to `until` (s)."""

    def rng(self, name: str) -> np.random.Generator:
        """Return the random generator of one part of the world, independent of the other parts."""
        return np.random.default_rng([self.settings.seed, zlib.crc32(name.encode())])

    def place(self, point: str) -> tuple[float, float]:
        """Return the position of a point of the table, as fractions of its width and height."""
        return place_of(self.file, point)

    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> None:
        """Step patches and surface: see `Surface.step`; `volts` are the amplifier's output at each patch."""
        linear_volts = self.patches.step(start, period, volts)
        with asked(self.surface, self.settings.plant):
            self.surface.step(start, period, linear_volts)

    def seen(self, times: FloatArray) -> FloatArray:
        """Return the velocity where the laser is aimed, behind its pole, (times,) m/s. See `Surface.seen`."""
        with asked(self.surface, self.settings.plant):
            velocity = self.surface.seen(self.place(self.aimed), times)
            if velocity.shape != times.shape or not np.isfinite(velocity).all():
                raise ValueError(
                    f"for {len(times)} times, a velocity of shape {velocity.shape}, or not finite"
                )
        return velocity

    def force(self, times: FloatArray) -> FloatArray:
        """Return the force of the finger on the button (N) at `times` (s), an array of any shape."""
        total = np.zeros(times.shape)
        if times.size:
            for press in self.presses.between(float(times.min()), float(times.max()), 0.0):
                total += press.force(times)
        return total

    def pressed(self, times: FloatArray) -> FloatArray:
        """Return the force (N) of all fingers and palms on the table at `times` (s), an array of any
        shape.
        """
        total = np.zeros(times.shape)
        if times.size:
            for hand in self.hands:
                total += hand.felt(times)
            for touch in self.touches:
                if touch.stop > times.min():
                    total += touch.force(times)
        return total

    # Actions of people

    def press(self, request: Press) -> None:
        """Schedule a participant's press of a button, after the reaction time."""
        with self._lock:
            finger = Finger.of(self.rng(f"finger of {request.participant}"))
            # The seed depends on the request alone, so that the press is the same whatever came before.
            name = f"{request.participant} presses {request.button}, {request.number}"
            rng = self.rng(name if request.attempt == 1 else f"{name}, attempt {request.attempt}")
            button, flaw = button_named(request.button), self._flaw(name, request.attempt)
            start = self.clock.now() + finger.reaction * float(rng.uniform(0.8, 1.25))
            press = press_button(button, finger, request, start, rng, flaw)
            self.presses.add(press)
            if flaw == "double":
                again = press.stop + float(rng.uniform(0.03, 0.2))
                self.presses.add(press_button(button, finger, request, again, rng, flaw))

    def touch(self, request: Touch) -> None:
        """Schedule a participant's press of the touch surface, after the reaction time."""
        with self._lock:
            finger = Finger.of(self.rng(f"finger of {request.participant}"))
            skin = skin_of(self.rng(f"skin of {request.participant}"))
            name = f"{request.participant} touches, {request.pressure}, {request.number}"
            rng = self.rng(f"{name} after {len(self.touches)}")
            start = self.clock.now() + finger.reaction * float(rng.uniform(0.8, 1.25))
            self.touches.append(touch_surface(request, skin, start, rng))

    def rest(self, request: RestFinger) -> None:
        """Let a participant rest a finger on the table from now on, with about the force asked for."""
        with self._lock:
            now, name = self.clock.now(), f"finger of {request.participant}"
            tip = Fingertip.of(self.rng(f"fingertip of {request.participant}"))
            rng = self.rng(f"{name} rests at {request.point}, {len(self.hands)}")
            self.hands.append(Hand(name, tip, self.place(request.point), request.force, now, rng))

    def lift(self) -> None:
        """Let every finger and palm leave the table from now on."""
        with self._lock:
            now = self.clock.now()
            self.advance(now)
            for hand in self.hands:
                hand.lift(now)

    def _change_hand(self, hand: Hand) -> None:
        """Make the change of a hand that is due; the plant has stepped to it."""
        self._resting[hand] = hand.change()
        self.surface.touched([one for contacts in self._resting.values() for one in contacts])

    def contact_area(self, times: FloatArray) -> FloatArray:
        """Return the contact area of the finger on the touch surface, (times,) m^2."""
        with self._lock:
            areas = np.zeros(len(times))
            for touch in self.touches:
                if touch.stop > times.min(initial=np.inf):
                    areas = np.maximum(areas, touch.area(times))
            return areas

    def _flaw(self, press: str, attempt: int) -> Flaw:
        """Return the flaw of an attempt at a press, or "". From the third attempt on there is none."""
        rng = self.rng(f"{press}, attempt {attempt}: clumsy")
        bad = rng.random() < self.settings.bad_press_rate and attempt <= 2
        return FLAWS[int(rng.integers(len(FLAWS)))] if bad else ""

    def aim(self, point: str) -> None:
        """Aim the laser at a point of the table."""
        with self._lock:
            self.place(point)
            self.aimed = point
            self._glue()

    def put(self, mass: float) -> None:
        """Set the additional mass on the force sensor to `mass` (kg), from now on."""
        with self._lock:
            self.loads.append((self.clock.now(), mass * GRAVITY))

    def _put_up(self, head: LaserHead) -> None:
        """Install a vibrometer's `head`, given as the rig file describes it."""
        self._heads.append((head, replace(head)))
        for fault in self.faults.at(OnLaser):
            fault.head(head)
        self.surface.laser_pole_hz = head.bandwidth_hz
        with asked(self.surface, self.settings.plant):
            self.surface.shows(head.quantity, head.high_pass_hz)
        self._glue()

    def _glue(self) -> None:
        """Let what is glued to the surface load it where it is."""
        mass = sum(head.mass for head, _ in self._heads)
        if mass:
            self.surface.load(self.place(self.aimed), mass)

    @property
    def set_as_filed(self) -> bool:
        """True when every vibrometer has the rig file's settings: the simulated operator's answer."""
        for fault in self.faults.at(OnLaser):
            fault.inspected(self.clock.now())
        return all((head.range, head.scale) == (filed.range, filed.scale) for head, filed in self._heads)


@dataclass(frozen=True, eq=False)
class Truth:
    """True values known only to the simulator: for tests and reports, never for an estimator."""

    _scene: Scene

    @property
    def presses(self) -> tuple[SimulatedPress, ...]:
        """All presses so far, in order."""
        return tuple(self._scene.presses.all)

    @property
    def touches(self) -> tuple[SimulatedTouch, ...]:
        """All presses of the touch surface so far, in order."""
        return tuple(self._scene.touches)

    def contact_area(self, times: FloatArray) -> FloatArray:
        """Return the finger's contact area on the touch surface, (times,) m^2."""
        return self._scene.contact_area(np.asarray(times, dtype=np.float64))

    @property
    def resonance_hz(self) -> float:
        """Present resonance of the first patch at the button (Hz): of the table, its mode near 263.5 Hz."""
        scene = self._scene
        place = scene.place("button")
        return scene.surface.resonance_hz(scene.surface.patches[0], place, scene.clock.now())

    @property
    def surface(self) -> Surface:
        """The surface itself; of one that has modes, `surface.modes(time)` are these."""
        return self._scene.surface

    def velocity_response(self, patch: str, point: str, frequencies: FloatArray) -> ComplexArray:
        """Return the response without hysteresis, (frequencies,) m/s per V at the patch, as it is now."""
        scene = self._scene
        scene.advance(scene.clock.now())
        return scene.surface.response(patch, scene.place(point), frequencies, scene.clock.now())

    def velocity(self, point: str, times: FloatArray) -> FloatArray:
        """Return the surface's own velocity at a point, (times,) m/s, at rising times (s of the rig's clock).

        No laser is in it: no pole, delay, noise, clipping or fault, so that a judge can be compared with it.
        Times reach from 30 s before the last output step to the clock's present time, which the first call
        brings the plant to. Raises ValueError for times outside.
        """
        scene, times = self._scene, np.asarray(times, dtype=np.float64)
        now = scene.clock.now()
        if len(times) and times[-1] > now:
            raise ValueError(f"The motion at {times[-1]:.3f} s lies in the future: it is {now:.3f} s.")
        scene.advance(now)
        return scene.surface.velocity(scene.place(point), times)

    @property
    def patch_voltages(self) -> dict[str, float]:
        """Present voltage across each patch (V)."""
        scene = self._scene
        now = np.array([scene.clock.now()])
        scene.advance(now[0])
        return {p: float(scene.patches.voltage(p, now)[0]) for p in scene.surface.patches}

    @property
    def closed(self) -> frozenset[str]:
        """Patches with closed contacts, now."""
        self._scene.advance(self._scene.clock.now())
        return frozenset(self._scene.closed)

    @property
    def peak(self) -> float:
        """Largest voltage magnitude applied to any patch so far (V)."""
        return self._scene.peak

    def record(self) -> list[AmplifierOutput]:
        """Record the amplifier's output from now on; return the list, which grows with time."""
        scene = self._scene
        scene.advance(scene.clock.now())
        scene.amplifier_record = []
        return scene.amplifier_record

    def began(self, record: Sequence[AmplifierOutput]) -> float:
        """Time (s) at which the first waveform of a record began that a closed contact passed.

        Not its first volts: a waveform may begin with zeros. Raises LookupError where none was passed.
        """
        for one in record:
            if one.closed and np.isfinite(one.period):
                return one.start
        raise LookupError("no waveform was passed to a patch")
