"""A surface as a sum of modes, driven by piezo patches and measured by a laser.

The solution is exact at any time: every drive is a staircase, so the state of each pole has a closed form
from its state at the last step. There is no numerical integration and no step size to choose, and a
channel that a multiplexed card samples 14 us late is evaluated 14 us later.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ...instruments.arrays import ComplexArray, FloatArray
from .poles import Course, Poles
from .surface import AMPLIFIER_POLE_HZ, REMEMBERED, Surface

__all__ = ["ModalPoles", "ModalSurface", "Modes"]


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

    def velocity(self, patch: str, place: tuple[float, float], frequencies: FloatArray) -> ComplexArray:
        """Return the response at a place (m/s per V at the patch), at `frequencies` (Hz)."""
        s = 2j * np.pi * np.asarray(frequencies)[:, None]
        w = 2 * np.pi * self.natural_hz
        strength = self.shape(place) * self.coupling[patch]
        return np.asarray((strength * s / (s**2 + 2 * self.damping * w * s + w**2)).sum(axis=1))


@dataclass(frozen=True, eq=False)
class ModalPoles:
    """Modes between amplifier and laser, as poles driven by the linear volts of all patches.

    There are the poles of the modes, and an amplifier and a laser pole for each patch. `forced` ones have
    further inputs: a force on each mode, which passes no amplifier, with the mode's pole and a laser pole.
    """

    modes: Modes
    poles: Poles
    amplifier: float
    laser: float
    """Poles of amplifier and laser (rad/s)."""
    _weights: dict[tuple[tuple[float, float], bool], ComplexArray] = field(default_factory=dict)

    @classmethod
    def of(cls, modes: Modes, amplifier: float, laser: float, forced: bool) -> ModalPoles:
        """Return the poles of modes; `amplifier` and `laser` are rad/s."""
        w, zeta = 2 * np.pi * modes.natural_hz, modes.damping
        own = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
        count, patches = len(own), len(modes.coupling)
        direct = np.concatenate([own, np.full(count, -laser)]) if forced else own[:0]
        poles = np.concatenate([own, [-amplifier, -laser] * patches, direct])
        inputs = np.zeros((len(poles), patches + len(direct) // 2))
        for i, coupling in enumerate(modes.coupling.values()):
            inputs[:count, i] = coupling
            inputs[count + 2 * i : count + 2 * i + 2, i] = 1.0
        if forced:
            inputs[count + 2 * patches :, patches:] = np.vstack([np.eye(count), np.eye(count)])
        return cls(modes, Poles(poles, inputs), amplifier, laser)

    def velocity(self, place: tuple[float, float], measured: bool) -> ComplexArray:
        """Return the partial fractions of amplifier x modes, (poles,), and x laser if `measured`.

        They are doubled for a pole with a conjugate, so that the real part of the sum is the velocity.
        """
        key = place, measured
        if key not in self._weights:
            a, c, modes = self.amplifier, self.laser, self.modes
            shape = modes.shape(place)
            w, count, patches = 2 * np.pi * modes.natural_hz, len(shape), len(modes.coupling)
            s, end = self.poles.poles[:count], count + 2 * patches
            own = np.zeros(len(self.poles.poles), dtype=np.complex128)
            moved = shape * s / (1j * s.imag) * (c / (s + c) if measured else 1.0)
            own[:count] = moved * a / (s + a)
            shares = [(-a, a * c / (c - a)), (-c, c * a / (a - c))] if measured else [(-a, a)]
            for at, share in shares:
                modal = shape * at / (at**2 + 2 * modes.damping * w * at + w**2)
                own[count + (at == -c) : end : 2] = share * (modal @ self.poles.inputs[:count, :patches])
            if len(own) > end:
                own[end : end + count] = moved
                if measured:
                    own[end + count :] = c * modal
            self._weights[key] = own
        return self._weights[key]


class ModalSurface(Surface):
    """See `Surface`. `modes` are constant, or a function of time (s) that is asked anew `every` so many s."""

    _forced = False
    """True when forces on single modes are added."""

    def __init__(self, modes: Modes | Callable[[float], Modes], every: float = np.inf) -> None:
        self._modes_at = modes if callable(modes) else lambda _time: modes
        self._every = every
        self.patches = tuple(self.modes(0.0).coupling)
        self._tuned = 0.0
        self._poles: ModalPoles | None = None
        self._course: Course[ModalPoles] | None = None

    def modes(self, time: float) -> Modes:
        """Return the modes at a time (s)."""
        return self._modes_at(time)

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

    def response(
        self, patch: str, place: tuple[float, float], frequencies: FloatArray, time: float
    ) -> ComplexArray:
        """See `Surface.response`."""
        return self.modes(time).velocity(patch, place, frequencies)

    def resonance_hz(self, patch: str, place: tuple[float, float], time: float) -> float:
        """See `Surface.resonance_hz`; the natural frequency of the main mode, if the modes name one."""
        modes = self.modes(time)
        if modes.main is None:
            return super().resonance_hz(patch, place, time)
        return float(modes.natural_hz[modes.main])

    def _at(self, time: float) -> tuple[Course[ModalPoles], ModalPoles]:
        """Return the course so far, and the poles in effect from `time` (s) on."""
        if self._poles is None or time - self._tuned >= self._every:
            # Equal poles would need another formula; shift one of them by a ten-thousandth.
            apart = 1.0001 if self.laser_pole_hz == AMPLIFIER_POLE_HZ else 1.0
            amplifier, laser = 2 * np.pi * AMPLIFIER_POLE_HZ, 2 * np.pi * self.laser_pole_hz * apart
            self._poles = ModalPoles.of(self.modes(time), amplifier, laser, self._forced)
            self._tuned = time
        if self._course is None:
            self._course = Course(self._poles, self._poles.poles, REMEMBERED)
        return self._course, self._poles
