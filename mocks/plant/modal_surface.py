"""A surface as a sum of modes, driven by piezo patches and measured by a laser; also one that softens.

The solution is exact at any time: every drive is a staircase, so the state of each pole has a closed form
from its state at the last step. There is no numerical integration and no step size to choose, and a
channel that a multiplexed card samples 14 us late is evaluated 14 us later.

The plant `Modal` is told mode by mode; random ones of it try estimators on surfaces of every kind.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
import scipy
from pydantic import Field, model_validator

from ...base.arrays import ComplexArray, FloatArray
from ...base.bounded import Finite, Positive, Proportion
from ...base.errors import ConfigurationError
from ...base.filters import first_order_low_pass
from ...instruments.config import RigFile
from ...instruments.vibrometer import DERIVATIVE, Quantity
from .modal import ModalPoles, Modes, Seeing
from .poles import Course
from .surface import REMEMBERED, Contact, PlantSettings, Surface, place_of, table_of
from .touched import TouchedPoles, motion_of, touched_velocity


class ModalSurface(Surface):
    """See `Surface`. `modes` are constant, or a function of time (s) that is asked anew `every` so many s."""

    _forced = False
    """True when forces on single modes are added."""

    def __init__(self, modes: Modes | Callable[[float], Modes], every: float = np.inf) -> None:
        self._modes_at = modes if callable(modes) else lambda _time: modes
        self._every = every
        self._glued: tuple[tuple[float, float], float] | None = None
        self._contacts: tuple[Contact, ...] | None = None
        """What rests on the surface; None as long as nothing has."""
        self.patches = tuple(self.modes(0.0).coupling)
        self._tuned = 0.0
        self._poles: ModalPoles | TouchedPoles | None = None
        self._course: Course[ModalPoles | TouchedPoles] | None = None
        self._power, self._high_pass_hz = 0, 0.0

    def modes(self, time: float) -> Modes:
        """Return the modes at a time (s), with what is glued to the surface."""
        modes = self._modes_at(time)
        return modes if self._glued is None else modes.loaded(*self._glued)

    def load(self, place: tuple[float, float], mass: float) -> None:
        """See `Surface.load`."""
        self._glued = (place, mass)
        self._poles = None

    def touched(self, contacts: Sequence[Contact]) -> None:
        """See `Surface.touched`. It is exact. Raises ConfigurationError for modes without masses."""
        if self._forced or self.modes(0.0).masses is None:
            why = "softens" if self._forced else "tells no masses of its modes"
            raise ConfigurationError(
                f"Nothing can rest on the simulated surface, because it {why}: simulate without softening, "
                "with a plant whose modes have masses, or without a finger."
            )
        self._contacts = tuple(contacts)
        self._poles = None

    def alter(self, change: Callable[[Modes, float], Modes], every: float = np.inf) -> None:
        """Change the modes at a time (s) by a function, before the first step; ask it anew `every` so many s.

        It must keep the number of modes and the patches.
        """
        before = self._modes_at
        self._modes_at = lambda time: change(before(time), time)
        self._every = min(self._every, every)

    def step(self, start: float, period: float, volts: Mapping[str, FloatArray]) -> None:
        """See `Surface.step`."""
        levels = np.array([volts[patch] for patch in self.patches])
        steps, first = levels.shape[1], 0
        while first < steps:
            at = start + first * period if first else start  # a held step has no end
            course, poles = self._at(at)
            left = self._tuned + self._every - at
            last = steps if left >= (steps - first) * period else first + max(1, round(left / period))
            if isinstance(poles, TouchedPoles):
                anew = partial(_converted, course.owner, poles) if course.owner is not poles else None
                course.step(poles, poles.poles, at, period, levels[:, first:last], anew)
            else:
                self._add(course, poles, at, period, levels[:, first:last])
            first = last

    def _add(
        self,
        course: Course[ModalPoles | TouchedPoles],
        poles: ModalPoles,
        start: float,
        period: float,
        levels: FloatArray,
    ) -> None:
        """Add linear volts of the patches, (patches, steps), during which the modes are constant."""
        course.step(poles, poles.poles, start, period, levels)

    def velocity(self, place: tuple[float, float], times: FloatArray) -> FloatArray:
        """See `Surface.velocity`. Raises ValueError for times that are no longer remembered."""
        course, _ = self._at(self._tuned)
        if len(times) and times[0] < course.begin:
            raise ValueError(
                f"The table's motion at {times[0]:.3f} s is no longer remembered: ask for times at most "
                f"{REMEMBERED:.0f} s before the last output step."
            )
        return course.seen(times, lambda poles: poles.velocity(place, measured=False))

    def seen(self, place: tuple[float, float], times: FloatArray) -> FloatArray:
        """See `Surface.seen`. It is exact."""
        course, _ = self._at(self._tuned)
        return course.seen(times, lambda poles: poles.velocity(place, measured=True))

    def shows(self, quantity: Quantity, high_pass_hz: float) -> None:
        """See `Surface.shows`. It is exact."""
        self._power, self._high_pass_hz = DERIVATIVE[quantity], high_pass_hz

    def response(
        self, patch: str, place: tuple[float, float], frequencies: FloatArray, time: float
    ) -> ComplexArray:
        """See `Surface.response`; of a coil it contains the current's lag behind the volts."""
        modes = self.modes(time)
        if self._contacts:
            found = touched_velocity(modes, self._contacts, place, frequencies)[patch]
        else:
            found = modes.velocity(patch, place, frequencies)
        if self.coil_pole_hz is not None:
            found = found * first_order_low_pass(frequencies, self.coil_pole_hz)
        return found

    def resonance_hz(self, patch: str, place: tuple[float, float], time: float) -> float:
        """See `Surface.resonance_hz`; the natural frequency of the main mode, if the modes name one."""
        modes = self.modes(time)
        if modes.main is None:
            return super().resonance_hz(patch, place, time)
        return float(modes.natural_hz[modes.main])

    def _at(self, time: float) -> tuple[Course[ModalPoles | TouchedPoles], ModalPoles | TouchedPoles]:
        """Return the course so far, and the poles in effect from `time` (s) on."""
        if self._poles is None or time - self._tuned >= self._every:
            driving = [self.amplifier_pole_hz, *([self.coil_pole_hz] if self.coil_pole_hz else [])]
            seeing = [self.laser_pole_hz, *([self._high_pass_hz] if self._high_pass_hz else [])]
            poles = _apart([2 * np.pi * hz for hz in (*driving, *seeing)])
            chain = tuple(poles[: len(driving)]), Seeing(tuple(poles[len(driving) :]), self._power)
            modes = self.modes(time)
            if self._contacts is None:
                self._poles = ModalPoles.of(modes, *chain, self._forced)
            else:
                self._poles = TouchedPoles(modes, self._contacts, *chain)
            self._tuned = time
        if self._course is None:
            self._course = Course(self._poles, self._poles.poles, REMEMBERED, lambda owner: owner.rest())
        return self._course, self._poles


def _converted(before: ModalPoles | TouchedPoles, now: TouchedPoles, states: ComplexArray) -> ComplexArray:
    """States of poles as those of the poles that follow them, with the same motion."""
    motion = before.motion(states) if isinstance(before, TouchedPoles) else motion_of(before, states)
    return now.states(motion)


def _apart(poles: Sequence[float]) -> list[float]:
    """Poles of which no two are equal: equal ones would need another formula. Each is off by little."""
    found: list[float] = []
    for pole in poles:
        shifted = pole
        while any(abs(shifted - other) < 5e-5 * other for other in found):
            shifted *= 1.0001
        found.append(shifted)
    return found


# A surface whose modes soften with amplitude, as glued and clamped panes do: bounded Duffing springs.
#
# The spring of each mode loses the share c x^2 / (1 + x^2) of its stiffness, where x is the displacement over
# `amplitude`: cubic for small motion (Duffing), and never unstable. The lost force is found step by step, by
# iteration, and then drives the modes, which are exact, as a staircase of its own: its error is that of one
# step (0.4 % of this small force at 2.5 kHz and 50 kS/s), not the motion's. Modes soften on their own,
# without coupling to each other; while an output is held between two plays, they ring on as for small motion.

_STEPS = 256
"""Steps that are iterated together: within them the phase of a softened mode turns by little."""
_ITERATIONS, _SMALL = 8, 1e-7
"""Most iterations, and the change of the force, relative to the largest, at which they end."""
_LONGEST = 1e-4
"""Longest step (s) whose force is computed; a longer one holds an output."""


class SofteningSurface(ModalSurface):
    """See the module. At `amplitude` (m, of a mode's own coordinate) a mode's frequency is lower by `shift`.

    `shift` is relative, and below 0.2.
    """

    _forced = True

    def __init__(
        self, modes: Modes | Callable[[float], Modes], shift: float, amplitude: float, every: float = np.inf
    ) -> None:
        super().__init__(modes, every)
        # The describing function of x^3 / (1 + x^2) at an amplitude of 1 is sqrt(2) - 1; a frequency falls by
        # half of what its stiffness loses.
        self._share = 2 * shift / (np.sqrt(2) - 1)
        self._amplitude = amplitude
        count, patches = len(self.modes(0.0).natural_hz), len(self.patches)
        self._state: ComplexArray = np.zeros(count, dtype=np.complex128)
        self._volts, self._held = np.zeros(patches), np.zeros(patches)
        self._end = 0.0

    def _add(
        self,
        course: Course[ModalPoles | TouchedPoles],
        poles: ModalPoles,
        start: float,
        period: float,
        levels: FloatArray,
    ) -> None:
        count = len(self._state)
        own = poles.poles.poles[:count]
        coupling = poles.poles.inputs[:count, : len(levels)].real
        self._rest_until(start, own, coupling, poles.amplifier)
        forces = np.zeros((count, levels.shape[1]))
        if period > _LONGEST:
            course.step(poles, poles.poles, start, period, np.vstack([levels, forces]))
            self._held = levels[:, -1]
            return
        for first in range(0, levels.shape[1], _STEPS):
            block = slice(first, first + _STEPS)
            forces[:, block] = self._forces(own, coupling, poles.amplifier, period, levels[:, block])
        course.step(poles, poles.poles, start, period, np.vstack([levels, forces]))
        self._held, self._end = levels[:, -1], start + levels.shape[1] * period
        # A force is not held with the output: it belongs to the motion.
        rest = np.concatenate([self._held, np.zeros(count)])[:, None]
        course.step(poles, poles.poles, self._end, np.inf, rest)

    def _rest_until(self, time: float, own: ComplexArray, coupling: FloatArray, amplifier: float) -> None:
        """Bring the states to a time (s), during which the outputs are held."""
        gap = time - self._end
        if gap <= 1e-9:
            return
        steady = -(coupling @ self._held) / own
        # What the amplifier still settles drives each mode for a fraction of a millisecond.
        settling = (coupling @ (self._volts - self._held)) / (-amplifier - own)
        decay = np.exp(own * gap)
        self._state = steady + (self._state - steady - settling) * decay + settling * np.exp(-amplifier * gap)
        self._volts = self._held + (self._volts - self._held) * np.exp(-amplifier * gap)
        self._end = time

    def _forces(
        self, own: ComplexArray, coupling: FloatArray, amplifier: float, period: float, levels: FloatArray
    ) -> FloatArray:
        """Return the lost force of each mode, (modes, steps), and bring the states to the last one's end."""
        decay = np.exp(-amplifier * period)
        behind, _ = scipy.signal.lfilter([0.0, 1 - decay], [1.0, -decay], levels, zi=self._volts[:, None])
        after = levels[:, -1] + (behind[:, -1] - levels[:, -1]) * decay
        mean = levels + (behind - levels) * (1 - decay) / (amplifier * period)
        driven = coupling @ mean
        stiffness = np.abs(own)[:, None] ** 2
        # A state is its decay times the sum of what was pushed in, each push freed of its own decay.
        turned = np.exp(own[:, None] * period * np.arange(levels.shape[1] + 1))
        gain = ((turned[:, 1] - 1) / own)[:, None] / turned[:, 1:]
        states, force = np.empty(turned.shape, dtype=np.complex128), np.zeros(driven.shape)
        for _ in range(_ITERATIONS):
            states[:, 0] = self._state
            states[:, 1:] = np.cumsum(gain * (driven + force), axis=1) + self._state[:, None]
            states[:, 1:] *= turned[:, 1:]
            motion = states.imag / own.imag[:, None]
            middle = (motion[:, 1:] + motion[:, :-1]) / 2
            x2 = (middle / self._amplitude) ** 2
            found = self._share * stiffness * middle * x2 / (1 + x2)
            change = np.abs(found - force).max()
            force = found
            if change <= _SMALL * max(float(np.abs(driven).max()), float(np.abs(found).max())):
                break
        self._state, self._volts = states[:, -1], after
        return force


_PEAK = 1e-4
"""Largest response of a random plant's first patch at the button, 60 to 600 Hz (m/s per V): the table's."""


class Modal(PlantSettings):
    """Modes, one by one: q'' + 2 damping w q' + w^2 q = coupling x linear volts, with unit modal mass."""

    natural_hz: tuple[Positive, ...]
    """Natural frequency of each mode (Hz)."""
    damping: tuple[Proportion, ...]
    """Damping ratio of each mode."""
    coupling: dict[str, tuple[Finite, ...]]
    """Modal force of each patch (m/s^2 per V), a number for each mode."""
    shapes: dict[str, tuple[Finite, ...]]
    """Mode shapes at each point, "button" or a point's number: a number for each mode."""

    masses: tuple[Positive, ...] | None = None
    """Mass of each mode (kg) where its shape is 1; without them nothing can rest on the surface."""
    softening: Annotated[float, Field(strict=True, ge=0, lt=0.2)] = 0.0
    """Relative fall of a mode's frequency when its coordinate is `soft_at`."""
    soft_at: Positive = 3e-6
    """Amplitude of a mode's coordinate (m) at which `softening` is meant."""

    @model_validator(mode="after")
    def _one_number_a_mode(self) -> Modal:
        lists = {"damping": self.damping}
        if self.masses is not None:
            lists["masses"] = self.masses
        lists |= {f"coupling.{patch}": values for patch, values in self.coupling.items()}
        lists |= {f"shapes.{point}": values for point, values in self.shapes.items()}
        for name, values in lists.items():
            if len(values) != len(self.natural_hz) or not values:
                raise ValueError(
                    f"{name} has {len(values)} numbers, and natural_hz has {len(self.natural_hz)}: give "
                    "one for each mode, and one mode at least"
                )
        return self

    def make(self, file: RigFile, rng: np.random.Generator) -> ModalSurface:
        """See `PlantSettings.make`."""
        table = table_of(file)
        known = {place_of(file, point): np.array(values) for point, values in self.shapes.items()}
        points = {place_of(file, str(n)): str(n) for n in range(table.rows * table.columns)}
        coupling = {patch: np.array(values) for patch, values in self.coupling.items()}
        shape = _Shape(known, points)
        masses = None if self.masses is None else np.array(self.masses)
        modes = Modes(np.array(self.natural_hz), np.array(self.damping), coupling, shape, masses=masses)
        if self.softening:
            return SofteningSurface(modes, self.softening, self.soft_at)
        return ModalSurface(modes)


@dataclass(frozen=True, eq=False)
class _Shape:
    known: Mapping[tuple[float, float], FloatArray]
    points: Mapping[tuple[float, float], str]

    def __call__(self, place: tuple[float, float]) -> FloatArray:
        if place not in self.known:
            raise ConfigurationError(
                f"The plant 'modal' has no shapes at the point {self.points.get(place, place)}: add it to "
                "`shapes`, or aim at another point."
            )
        return self.known[place]


def random_modal(
    rng: np.random.Generator,
    modes: int | None = None,
    damping: tuple[float, float] = (0.002, 0.05),
    close_pairs: int | None = None,
) -> Modal:
    """Draw a plant: 6 to 60 modes from 50 Hz to 2.5 kHz, with damping ratios drawn between two limits.

    `close_pairs` of the modes (0 to 3 if None) lie within half to three half-widths of another one. The
    largest response of patch A at the button, 60 to 600 Hz, is 1e-4 m/s per V, which is the table's.
    """
    count = int(rng.integers(6, 61)) if modes is None else modes
    natural = np.sort(np.exp(rng.uniform(np.log(50), np.log(2500), count)))
    # One mode in the middle of the band at least, or there is nothing to play on.
    natural[np.abs(natural - 250).argmin()] = rng.uniform(150, 400)
    ratios = np.exp(rng.uniform(np.log(damping[0]), np.log(damping[1]), count))
    pairs = int(rng.integers(0, 4)) if close_pairs is None else close_pairs
    for k in rng.choice(count, 2 * min(pairs, count // 2), replace=False).reshape(-1, 2):
        half_width = ratios[k[0]] * natural[k[0]]
        natural[k[1]] = natural[k[0]] + rng.choice([-1, 1]) * rng.uniform(0.5, 3) * half_width
    coupling = {patch: rng.standard_normal(count) * natural for patch in "ABCD"}
    shape = rng.uniform(-1, 1, count)
    band = np.arange(60.0, 600.0, 0.1)
    drawn = Modes(natural, ratios, coupling, lambda _place: shape)
    gain = _PEAK / float(np.abs(drawn.velocity("A", (0.0, 0.0), band)).max())
    return Modal(
        natural_hz=tuple(natural.tolist()),
        damping=tuple(ratios.tolist()),
        coupling={patch: tuple((gain * force).tolist()) for patch, force in coupling.items()},
        shapes={"button": tuple(shape.tolist())},
    )
