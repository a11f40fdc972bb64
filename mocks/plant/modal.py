"""Modes of a surface, and the poles of modes between amplifier and laser."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from .poles import Poles

_PART = 256
"""Frequencies at which a response is computed at a time: all of them at all modes are 80 MB."""


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
        every = 2j * np.pi * np.asarray(frequencies)[:, None]
        w = 2 * np.pi * self.natural_hz
        strength = self.shape(place) * self.coupling[patch]
        found = np.empty(len(every), dtype=np.complex128)
        for first in range(0, len(every), _PART):
            s = every[first : first + _PART]
            found[first : first + _PART] = (strength * s / (s**2 + 2 * self.damping * w * s + w**2)).sum(
                axis=1
            )
        return found


class Passing(Protocol):
    """A transfer function from the surface's velocity, whose poles are among those of the seeing chain."""

    def gain(self, s: ComplexArray | complex) -> Any:
        """Value at s (rad/s)."""

    def residue(self, which: int) -> complex:
        """Residue at a pole of the seeing chain."""


@dataclass(frozen=True)
class Power:
    """The surface's own motion: its velocity times a power of s; -1 for displacement."""

    power: int = 0

    def gain(self, s: ComplexArray | complex) -> Any:
        """See `Passing`."""
        return 1.0 * s**self.power

    def residue(self, which: int) -> complex:
        """See `Passing`."""
        return 0.0


@dataclass(frozen=True)
class Seeing:
    """From the surface's velocity to what a pick-up shows: a low-pass, perhaps a high-pass, and a derivative.

    `poles` are (low-pass, high-pass if there is one), in rad/s. `power` is that of s: -1 for displacement, 1
    for acceleration.
    """

    poles: tuple[float, ...]
    power: int = 0

    def gain(self, s: ComplexArray | complex) -> Any:
        """See `Passing`."""
        low, *high = self.poles
        found = low / (s + low) * s**self.power
        return found * s / (s + high[0]) if high else found

    def residue(self, which: int) -> complex:
        """See `Passing`."""
        low, *high = self.poles
        at = complex(-self.poles[which])
        if which == 0:
            return complex(low * at**self.power * (at / (at + high[0]) if high else 1.0))
        return complex(at * low / (at + low) * at**self.power)


def low_passes(s: Any, poles: tuple[float, ...], without: int | None = None) -> Any:
    """Return the product of the low-passes of poles (rad/s) at s, but for one of them."""
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

    def rest(self) -> None:
        """Forget what is large, until it is asked for again."""
        self.poles.rest()

    def velocity(self, place: tuple[float, float], measured: bool) -> ComplexArray:
        """Return the partial fractions of driving x modes, (poles,), and x seeing if `measured`.

        They are doubled for a pole with a conjugate, so that the real part of the sum is what is seen.
        """
        key = place, measured
        if key not in self._weights:
            passing = self.seeing if measured else Power()
            self._weights[key] = self.passed(self.modes.shape(place), passing)
        return self._weights[key]

    def passed(self, shape: FloatArray, seeing: Passing) -> ComplexArray:
        """Return the weights, (poles,), as `velocity`, where the modes have a `shape`, (modes,)."""
        modes = self.modes
        w, count, patches = 2 * np.pi * modes.natural_hz, len(shape), len(modes.coupling)
        chain = len(self.driving) + len(self.seeing.poles)
        s, end = self.poles.poles[:count], count + chain * patches
        own = np.zeros(len(self.poles.poles), dtype=np.complex128)
        moved = shape * s / (1j * s.imag) * seeing.gain(s)
        own[:count] = moved * low_passes(s, self.driving)
        coupling = self.poles.inputs[:count, :patches]
        for k, pole in enumerate((*self.driving, *self.seeing.poles)):
            at = complex(-pole)
            modal = shape * at / (at**2 + 2 * modes.damping * w * at + w**2)
            seen = k - len(self.driving)
            if seen < 0:
                share = low_passes(at, self.driving, without=k) * pole * seeing.gain(at)
            else:
                share = low_passes(at, self.driving) * seeing.residue(seen)
            own[count + k : end : chain] = share * (modal @ coupling)
            if seen >= 0 and len(own) > end:
                own[end + count * (seen + 1) : end + count * (seen + 2)] = seeing.residue(seen) * modal
        if len(own) > end:
            own[end : end + count] = moved
        return own
