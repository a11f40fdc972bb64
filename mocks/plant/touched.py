"""Modes with bodies that rest on the surface, between amplifier and laser: exact poles, and exact contact.

Modes (q'' + 2 z w q' + w^2 q = coupling x volts, of mass m each) and bodies (mass M behind a spring k and a
damper c at a place where the modes have the shape p) are one linear system:

    m (q'' + 2 z w q' + w^2 q) = m coupling x volts - p F,    M x'' = F,    F = k (p q - x) + c (p q' - x')

A damper at one place couples the modes, so that its poles and shapes are those of the whole matrix, not of
single modes. A body that comes, goes or presses harder changes the system, and not the motion: displacements,
velocities, and what amplifier and laser hold go on from where they are; a new body is where the surface is,
and at rest. Static forces are not in it: a finger's push bends the pane far below every band.

The laser holds what it has seen of each mode, because a change of the system leaves that as it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from .contact import Contact
from .coupled import Coupled
from .modal import ModalPoles, Modes, Passing, Power, Seeing, low_passes
from .poles import Poles


@dataclass(frozen=True, eq=False)
class Motion:
    """What goes on when the bodies on a surface change."""

    modes: FloatArray
    """Displacement and velocity of each mode, (2, modes)."""
    bodies: Mapping[str, FloatArray]
    """Displacement and velocity of each body, (2,)."""
    driving: FloatArray
    """What each stage of the driving chain holds of each patch, (stages, patches)."""
    seeing: FloatArray
    """What each stage of the seeing chain holds of each mode, (stages, modes)."""


@dataclass(frozen=True)
class _Stage:
    """A stage of the seeing chain: the low-pass, or behind it 1 / (s + high-pass)."""

    seeing: Seeing
    number: int

    def gain(self, s: ComplexArray | complex) -> ComplexArray | complex:
        low, *high = self.seeing.poles
        passed = low / (s + low) * s**self.seeing.power
        return passed / (s + high[0]) if self.number else passed

    def residue(self, which: int) -> complex:
        if which > self.number:
            return 0.0
        low, *high = self.seeing.poles
        if which:
            return complex(low / (low - high[0]) * complex(-high[0]) ** self.seeing.power)
        own = low * complex(-low) ** self.seeing.power
        return own / (high[0] - low) if self.number else own


@dataclass(frozen=True, eq=False)
class TouchedPoles:
    """See the module. There are the poles of modes and bodies, one of each pair, and of both chains.

    In this order: modes and bodies, for each patch those of the driving chain, and for each of the seeing
    chain one a mode.
    """

    modes: Modes
    contacts: tuple[Contact, ...]
    driving: tuple[float, ...]
    seeing: Seeing
    _weights: dict[tuple[tuple[float, float], bool], ComplexArray] = field(default_factory=dict)

    @cached_property
    def _own(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """See `Coupled.solved`."""
        return Coupled(self.modes, self.contacts).solved()

    @cached_property
    def _inputs(self) -> ComplexArray:
        """How each patch drives the poles of modes and bodies, (poles, patches)."""
        return np.asarray(self._own[2][:, self._velocities] @ np.array(list(self.modes.coupling.values())).T)

    @cached_property
    def poles(self) -> Poles:
        """The poles of all, and how each patch drives them."""
        own, patches = self._own[0], len(self.modes.coupling)
        chain = np.tile([-pole for pole in self.driving], patches)
        seen = np.repeat([-pole for pole in self.seeing.poles], len(self.modes.natural_hz))
        inputs = [self._inputs, np.repeat(np.eye(patches), len(self.driving), axis=0)]
        for pole in self.seeing.poles:
            inputs.append(self._forced(-pole)[self._velocities] * low_passes(complex(-pole), self.driving))
        return Poles(np.concatenate([own, chain, seen]), np.concatenate(inputs))

    def rest(self) -> None:
        """See `ModalPoles.rest`."""
        self.poles.rest()
        self.__dict__.pop("_own", None)

    @property
    def _velocities(self) -> slice:
        """Where a state has the velocities of modes."""
        start = len(self.modes.natural_hz) + len(self.contacts)
        return slice(start, start + len(self.modes.natural_hz))

    def _forced(self, s: float) -> FloatArray:
        """State per volt behind the driving chain, at a real s: (states, patches)."""
        own, vectors, _ = self._own
        return np.asarray((vectors @ (self._inputs / (s - own)[:, None])).real)

    def velocity(self, place: tuple[float, float], measured: bool) -> ComplexArray:
        """See `ModalPoles.velocity`."""
        key = place, measured
        if key not in self._weights:
            seeing: Passing = self.seeing if measured else Power()
            self._weights[key] = self.modes.shape(place) @ self._passed(seeing)
        return self._weights[key]

    def _passed(self, passing: Passing) -> ComplexArray:
        """Weights, (modes, poles), of what passes of each mode's velocity."""
        found = self._moving(self._velocities, passing)
        count = len(self.modes.natural_hz)
        first = len(self.poles.poles) - count * len(self.seeing.poles)
        for which in range(len(self.seeing.poles)):
            at = slice(first + which * count, first + (which + 1) * count)
            found[:, at] = passing.residue(which) * np.eye(count)
        return found

    def _moving(self, rows: slice, passing: Passing) -> ComplexArray:
        """Weights, (rows, poles), of rows of the state behind the driving chain and what passes."""
        own, vectors, _ = self._own
        found = np.zeros((rows.stop - rows.start, len(self.poles.poles)), dtype=np.complex128)
        found[:, : len(own)] = vectors[rows] * low_passes(own, self.driving) * passing.gain(own)
        stages = len(self.driving)
        end = len(own) + stages * len(self.modes.coupling)
        for k, pole in enumerate(self.driving):
            share = low_passes(complex(-pole), self.driving, without=k) * pole * passing.gain(complex(-pole))
            found[:, len(own) + k : end : stages] = share * self._forced(-pole)[rows]
        return found

    def motion(self, states: ComplexArray) -> Motion:
        """Return the motion that states, (poles,), stand for."""
        n = len(self.modes.natural_hz) + len(self.contacts)
        every = (self._moving(slice(0, 2 * n), Power()) @ states).real.reshape(2, n)
        count = len(self.modes.natural_hz)
        stages = [_Stage(self.seeing, k) for k in range(len(self.seeing.poles))]
        first, patches = len(self._own[0]), len(self.modes.coupling)
        chain = states[first : first + len(self.driving) * patches].real.reshape(patches, -1).T
        return Motion(
            every[:, :count],
            {one.name: every[:, count + k] for k, one in enumerate(self.contacts)},
            _driving_shares(self.driving) @ chain,
            np.array([(self._passed(stage) @ states).real for stage in stages]),
        )

    def states(self, motion: Motion) -> ComplexArray:
        """Return the states, (poles,), that stand for a motion. A body that is new in it begins at rest."""
        own, _, inverse = self._own
        count = len(self.modes.natural_hz)
        found = np.zeros(len(self.poles.poles), dtype=np.complex128)
        chain = np.linalg.solve(_driving_shares(self.driving), motion.driving)
        end = len(own) + chain.size
        found[len(own) : end] = chain.T.ravel()
        begins = [
            motion.bodies.get(one.name, np.array([self.modes.shape(one.place) @ motion.modes[0], 0.0]))
            for one in self.contacts
        ]
        bodies = np.array(begins).reshape(-1, 2).T
        state = np.concatenate([motion.modes, bodies], axis=1).ravel()
        held = self._moving(slice(0, len(state)), Power())[:, len(own) : end] @ found[len(own) : end]
        found[: len(own)] = inverse @ (state - held.real) / low_passes(own, self.driving)
        # A stage holds what comes from all poles before it, and from its own.
        for which in range(len(self.seeing.poles)):
            stage = _Stage(self.seeing, which)
            others = (self._passed(stage) @ found).real
            at = slice(end + which * count, end + (which + 1) * count)
            found[at] = (motion.seeing[which] - others) / stage.residue(which)
        return found


def motion_of(bare: ModalPoles, states: ComplexArray) -> Motion:
    """Return the motion that states, (poles,), of a surface stand for on which nothing has rested yet."""
    unit, patches = np.eye(len(bare.modes.natural_hz)), len(bare.modes.coupling)

    def of(passing: Passing) -> FloatArray:
        return np.array([(bare.passed(shape, passing) @ states).real for shape in unit])

    stages = len(bare.driving) + len(bare.seeing.poles)
    chain = states[len(unit) : len(unit) + stages * patches].real.reshape(patches, stages).T
    seen = [of(_Stage(bare.seeing, k)) for k in range(len(bare.seeing.poles))]
    driving = _driving_shares(bare.driving) @ chain[: len(bare.driving)]
    return Motion(np.array([of(Power(-1)), of(Power())]), {}, driving, np.array(seen))


def touched_velocity(
    modes: Modes, contacts: Sequence[Contact], place: tuple[float, float], frequencies: FloatArray
) -> dict[str, ComplexArray]:
    """Return the response of each patch at a place (m/s per V), at `frequencies` (Hz), under contacts."""
    s = np.asarray(2j * np.pi * np.asarray(frequencies), dtype=np.complex128)
    forces = np.array(list(modes.coupling.values())).T
    moved = Coupled(modes, contacts).displacement(s, modes.shape(place), forces)
    return dict(zip(modes.coupling, np.asarray((s[:, None] * moved).T), strict=True))


def _driving_shares(driving: tuple[float, ...]) -> FloatArray:
    """What each stage of the driving chain holds of each of its poles, (stages, poles)."""
    shares = np.zeros((len(driving), len(driving)))
    for stage in range(len(driving)):
        for k in range(stage + 1):
            passed = low_passes(complex(-driving[k]), driving[: stage + 1], without=k)
            shares[stage, k] = (passed * driving[k]).real
    return shares
