"""A surface as a sum of modes, driven by piezo patches and measured by a laser.

The solution is exact at any time: every drive is a staircase, so the state of each pole has a closed form
from its state at the last step. There is no numerical integration and no step size to choose, and a
channel that a multiplexed card samples 14 us late is evaluated 14 us later.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...instruments.arrays import ComplexArray, FloatArray
from ...instruments.sensors import low_pass
from ...instruments.vibrometer import DERIVATIVE, Quantity
from .poles import Course, Poles
from .surface import REMEMBERED, Surface

__all__ = ["ModalPoles", "ModalSurface", "Modes", "Seeing"]


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of one surface: q'' + 2 damping w q' + w^2 q = coupling x linear volts, with unit modal mass."""

    natural_hz: FloatArray
    """Natural frequencies, (modes,) Hz."""
    damping: FloatArray
    """Damping ratios, (modes,), below 1."""
    coupling: Mapping[str, FloatArray]
    """Modal force of each patch, (modes,) m/s^2 per V."""
    shape: Callable[[tuple[float, float]], FloatArray]
    """Function that returns the mode shapes, (modes,), at a place (fractions of width and height)."""
    main: int | None = None
    """Index of the mode that is meant to carry buttons; None for the largest response."""
    masses: FloatArray | None = None
    """Modal masses, (modes,) kg, by which a glued mass loads them; None when they are not known."""

    def loaded(self, place: tuple[float, float], mass: float) -> Modes:
        """Return the modes with a mass (kg) glued to a place: to first order, mode by mode (Rayleigh)."""
        if self.masses is None or not mass:
            return self
        more = 1 + mass * self.shape(place) ** 2 / self.masses
        return replace(
            self,
            natural_hz=self.natural_hz / np.sqrt(more),
            damping=self.damping / np.sqrt(more),
            coupling={patch: force / more for patch, force in self.coupling.items()},
            masses=self.masses * more,
        )

    def velocity(self, patch: str, place: tuple[float, float], frequencies: FloatArray) -> ComplexArray:
        """Return the response at a place (m/s per V at the patch), at `frequencies` (Hz)."""
        s = 2j * np.pi * np.asarray(frequencies)[:, None]
        w = 2 * np.pi * self.natural_hz
        strength = self.shape(place) * self.coupling[patch]
        return np.asarray((strength * s / (s**2 + 2 * self.damping * w * s + w**2)).sum(axis=1))


@dataclass(frozen=True)
class Seeing:
    """From the surface's velocity to what a pick-up shows: a low-pass, perhaps a high-pass, and a derivative.

    `poles` are (low-pass, high-pass if there is one), in rad/s. `power` is that of s: -1 for displacement, 1
    for acceleration. One that does not pass through them shows the surface's own motion.
    """

    poles: tuple[float, ...]
    power: int = 0
    passes: bool = True

    def gain(self, s: ComplexArray | complex) -> Any:
        """Value at s (rad/s)."""
        if not self.passes:
            return 1.0 + 0.0 * s
        low, *high = self.poles
        found = low / (s + low) * s**self.power
        return found * s / (s + high[0]) if high else found

    def residue(self, which: int) -> complex:
        """Residue at one of its poles; 0 when it does not pass through them."""
        if not self.passes:
            return 0.0
        low, *high = self.poles
        at = complex(-self.poles[which])
        if which == 0:
            return complex(low * at**self.power * (at / (at + high[0]) if high else 1.0))
        return complex(at * low / (at + low) * at**self.power)


def _low_passes(s: Any, poles: tuple[float, ...], without: int | None = None) -> Any:
    """Product of the low-passes of poles (rad/s) at s, but for one of them."""
    found = 1.0 + 0.0 * s
    for k, pole in enumerate(poles):
        if k != without:
            found = found * pole / (s + pole)
    return found


@dataclass(frozen=True, eq=False)
class ModalPoles:
    """Modes between amplifier and laser, as poles driven by the linear volts of all patches.

    Between the volts and a mode's force lie the low-passes of `driving` (amplifier, coil), between the mode's
    velocity and what is seen the `Seeing`. There are the poles of the modes, and for each patch those of
    both chains. `forced` ones have further inputs: a force on each mode, which passes no amplifier, with the
    mode's pole and those of the seeing chain.
    """

    modes: Modes
    poles: Poles
    driving: tuple[float, ...]
    """Poles of the driving chain (rad/s); the amplifier's is the first."""
    seeing: Seeing
    _weights: dict[tuple[tuple[float, float], bool], ComplexArray] = field(default_factory=dict)

    @classmethod
    def of(cls, modes: Modes, driving: tuple[float, ...], seeing: Seeing, forced: bool) -> ModalPoles:
        """Return the poles of modes; `driving` are rad/s, all poles apart from each other."""
        w, zeta = 2 * np.pi * modes.natural_hz, modes.damping
        own = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
        count, patches = len(own), len(modes.coupling)
        chain = [-pole for pole in (*driving, *seeing.poles)]
        direct = np.concatenate([own, *(np.full(count, -p) for p in seeing.poles)]) if forced else own[:0]
        poles = np.concatenate([own, chain * patches, direct])
        inputs = np.zeros((len(poles), patches + (count if forced else 0)))
        for i, coupling in enumerate(modes.coupling.values()):
            inputs[:count, i] = coupling
            inputs[count + len(chain) * i : count + len(chain) * (i + 1), i] = 1.0
        if forced:
            inputs[count + len(chain) * patches :, patches:] = np.tile(
                np.eye(count), (len(seeing.poles) + 1, 1)
            )
        return cls(modes, Poles(poles, inputs), driving, seeing)

    @property
    def amplifier(self) -> float:
        """Pole of the amplifier (rad/s)."""
        return self.driving[0]

    def velocity(self, place: tuple[float, float], measured: bool) -> ComplexArray:
        """Return the partial fractions of driving x modes, (poles,), and x seeing if `measured`.

        They are doubled for a pole with a conjugate, so that the real part of the sum is what is seen.
        """
        key = place, measured
        if key not in self._weights:
            modes, seeing = self.modes, self.seeing if measured else Seeing(self.seeing.poles, passes=False)
            shape = modes.shape(place)
            w, count, patches = 2 * np.pi * modes.natural_hz, len(shape), len(modes.coupling)
            chain = len(self.driving) + len(self.seeing.poles)
            s, end = self.poles.poles[:count], count + chain * patches
            own = np.zeros(len(self.poles.poles), dtype=np.complex128)
            moved = shape * s / (1j * s.imag) * seeing.gain(s)
            own[:count] = moved * _low_passes(s, self.driving)
            coupling = self.poles.inputs[:count, :patches]
            for k, pole in enumerate((*self.driving, *self.seeing.poles)):
                at = complex(-pole)
                modal = shape * at / (at**2 + 2 * modes.damping * w * at + w**2)
                seen = k - len(self.driving)
                if seen < 0:
                    share = _low_passes(at, self.driving, without=k) * pole * seeing.gain(at)
                else:
                    share = _low_passes(at, self.driving) * seeing.residue(seen)
                own[count + k : end : chain] = share * (modal @ coupling)
                if seen >= 0 and len(own) > end:
                    own[end + count * (seen + 1) : end + count * (seen + 2)] = seeing.residue(seen) * modal
            if len(own) > end:
                own[end : end + count] = moved
            self._weights[key] = own
        return self._weights[key]


class ModalSurface(Surface):
    """See `Surface`. `modes` are constant, or a function of time (s) that is asked anew `every` so many s."""

    _forced = False
    """True when forces on single modes are added."""

    def __init__(self, modes: Modes | Callable[[float], Modes], every: float = np.inf) -> None:
        self._modes_at = modes if callable(modes) else lambda _time: modes
        self._every = every
        self._glued: tuple[tuple[float, float], float] | None = None
        self.patches = tuple(self.modes(0.0).coupling)
        self._tuned = 0.0
        self._poles: ModalPoles | None = None
        self._course: Course[ModalPoles] | None = None
        self._power, self._high_pass_hz = 0, 0.0

    def modes(self, time: float) -> Modes:
        """Return the modes at a time (s), with what is glued to the surface."""
        modes = self._modes_at(time)
        return modes if self._glued is None else modes.loaded(*self._glued)

    def load(self, place: tuple[float, float], mass: float) -> None:
        """See `Surface.load`."""
        self._glued = (place, mass)
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
            self._add(course, poles, at, period, levels[:, first:last])
            first = last

    def _add(
        self,
        course: Course[ModalPoles],
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
        found = self.modes(time).velocity(patch, place, frequencies)
        return found if self.coil_pole_hz is None else found * low_pass(frequencies, self.coil_pole_hz)

    def resonance_hz(self, patch: str, place: tuple[float, float], time: float) -> float:
        """See `Surface.resonance_hz`; the natural frequency of the main mode, if the modes name one."""
        modes = self.modes(time)
        if modes.main is None:
            return super().resonance_hz(patch, place, time)
        return float(modes.natural_hz[modes.main])

    def _at(self, time: float) -> tuple[Course[ModalPoles], ModalPoles]:
        """Return the course so far, and the poles in effect from `time` (s) on."""
        if self._poles is None or time - self._tuned >= self._every:
            driving = [self.amplifier_pole_hz, *([self.coil_pole_hz] if self.coil_pole_hz else [])]
            seeing = [self.laser_pole_hz, *([self._high_pass_hz] if self._high_pass_hz else [])]
            poles = _apart([2 * np.pi * hz for hz in (*driving, *seeing)])
            chain = tuple(poles[: len(driving)]), Seeing(tuple(poles[len(driving) :]), self._power)
            self._poles = ModalPoles.of(self.modes(time), *chain, self._forced)
            self._tuned = time
        if self._course is None:
            self._course = Course(self._poles, self._poles.poles, REMEMBERED)
        return self._course, self._poles


def _apart(poles: Sequence[float]) -> list[float]:
    """Poles of which no two are equal: equal ones would need another formula. Each is off by little."""
    found: list[float] = []
    for pole in poles:
        shifted = pole
        while any(abs(shifted - other) < 5e-5 * other for other in found):
            shifted *= 1.0001
        found.append(shifted)
    return found
