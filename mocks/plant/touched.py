"""Modes with bodies that rest on the surface, between amplifier and laser: exact poles, and exact contact.

Modes (q'' + 2 z w q' + w^2 q = coupling x volts, of mass m each) and bodies (mass M behind a spring k and a
damper c at a place where the modes have the shape p) are one linear system:

    m (q'' + 2 z w q' + w^2 q) = m coupling x volts - p F,    M x'' = F,    F = k (p q - x) + c (p q' - x')

A damper at one place couples the modes, so that its poles and shapes are those of the whole matrix, not of
single modes. A body that comes, goes or presses harder changes the system, and not the motion: displacements,
velocities, and what amplifier and laser hold go on from where they are; a new body is where the surface is,
and at rest. Static forces are not in it: a finger's push bends the pane far below every band.

The laser holds what it has seen of each mode, because a change of the system leaves that as it was.

The common poles are found without the whole matrix. Modes alone are a diagonal. Bodies, of which there are
few, push on them at their places only: with the modes' shapes P, (modes, bodies), a pole s, its displacements
q and its forces F, (bodies,), fulfil

    D(s) q = -P F,    F / Z(s) = P' q,    hence (1 / Z + P' D^-1 P) F = 0

with D = m (s^2 + 2 z w s + w^2) of each mode, and 1 / Z = 1 / (k + c s) + 1 / (M s^2), a body behind its
spring and damper. That is a small matrix, in place of one of twice all modes and bodies. Its roots are found
together by Aberth's method, which is Newton's with each root repelled by all others, so that no two end at
one place. It starts from the poles that the lowest modes and the bodies have together, by the whole matrix,
and from each mode above pushed on its own (Rayleigh). As mass, stiffness and damping are symmetric, a pole's
vector from the left is its own. A mode with a node at every body keeps its pole.

On a pane with 236 modes it differs from the whole matrix's eigenvalues by less than 1e-9 of the response, and
takes a tenth of the time.

Sources: Aberth, Math. Comp. 27 (1973), 339; Tisseur and Meerbergen, SIAM Rev. 43 (2001), 235, section 3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...base.arrays import ComplexArray, FloatArray, IntArray
from .modal import ModalPoles, Modes, Passing, Power, Seeing, low_passes
from .poles import Poles
from .surface import Contact

_LOWEST = 40
"""Modes whose common poles with the bodies are found by a full solution."""
_NODE = 1e-5
"""Share of the largest coupling below which a mode has a node at every body."""
_ROUNDS, _FOUND = 40, 1e-11
"""Most rounds of Aberth's method, and the largest step, relative to the pole, after which it has ended."""
_BESIDE = 1 + 1e-12
"""Where a round looks beside each pole, relative to it: at a root itself, a matrix cannot be solved."""
_REAL = 1e-12
"""Imaginary part of a real pole, relative to it, that is nothing but rounding."""
_WHOLE = 1e-9
"""Largest error of the sum of all poles, relative to that of their sizes, with which none is missing."""


class Coupled:
    """See the module. States are displacements of modes and bodies, then their velocities, (states,)."""

    def __init__(self, modes: Modes, contacts: Sequence[Contact]) -> None:
        assert modes.masses is not None
        self._own = 2 * np.pi * modes.natural_hz
        self._loss = 2 * modes.damping * self._own
        self._mass = modes.masses
        self._count = len(self._own)
        shapes = [modes.shape(one.place) for one in contacts]
        self._at = np.array(shapes, dtype=np.float64).reshape(len(contacts), self._count).T
        each = np.array([(one.stiffness, one.damping, one.mass) for one in contacts], dtype=np.float64)
        self._stiffness, self._damping, self._body = each.reshape(-1, 3).T
        pull = np.abs(self._at).max(axis=1, initial=0.0) / np.sqrt(self._mass)
        self._free = pull <= _NODE * pull.max()

    def displacement(self, s: ComplexArray, shape: FloatArray, forces: FloatArray) -> ComplexArray:
        """Return what each patch moves, (values, patches), where the modes have a `shape`, (modes,).

        `s` are values (rad/s) that are no poles; `forces` the patches' on each mode over the modes' masses,
        (modes, patches).
        """
        inverse = 1 / self._dynamic(s)
        moved = inverse @ (shape[:, None] * forces)
        if not len(self._body):
            return np.asarray(moved)
        pairs = (self._at[:, :, None] * forces[:, None, :]).reshape(self._count, -1)
        under = (inverse @ pairs).reshape(len(s), -1, forces.shape[1])
        push = self._push(s)[:, :, None]
        held = np.linalg.solve(np.eye(len(self._body)) + push * self._compliance(inverse), push * under)
        lost = inverse @ (shape[:, None] * self._at / self._mass[:, None])
        return np.asarray(moved - (lost[:, None] @ held)[:, 0])

    def solved(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return the poles, one of each pair; their vectors, (states, poles), doubled; and the inverse.

        The inverse, (poles, states), tells how much of each a state has.
        """
        held = np.flatnonzero(self._free)
        poles = self._poles(np.flatnonzero(~self._free))
        forces = _null(self._matrix(poles))
        bare = self._bare()[held]
        s = np.concatenate([poles, bare])
        x = np.zeros((self._count + len(self._body), len(s)), dtype=np.complex128)
        x[: self._count, : len(poles)] = -(self._at / self._mass[:, None]) @ forces.T
        x[: self._count, : len(poles)] /= self._dynamic(poles).T
        x[self._count :, : len(poles)] = (forces / (self._body * poles[:, None] ** 2)).T
        x[held] = 0.0
        x[held, len(poles) + np.arange(len(held))] = 1.0
        x /= np.abs(x).max(axis=0)
        mass = np.concatenate([self._mass, self._body])[:, None] * x
        across = self._damping[:, None] * (self._at.T @ x[: self._count] - x[self._count :])
        lost = np.concatenate(
            [(self._loss * self._mass)[:, None] * x[: self._count] + self._at @ across, -across]
        )
        whole = (x * (2 * s * mass + lost)).sum(axis=0)
        inverse = np.concatenate([s * mass + lost, mass]) / whole
        doubled = np.concatenate([x, s * x]) * np.where(s.imag > 0, 2.0, 1.0)
        return s, doubled, inverse.T

    def _bare(self) -> ComplexArray:
        """The poles of the modes on their own."""
        return np.asarray(-self._loss / 2 + 1j * np.sqrt(self._own**2 - self._loss**2 / 4))

    def _dynamic(self, s: ComplexArray) -> ComplexArray:
        """s^2 + 2 z w s + w^2, (values, modes)."""
        return np.asarray(s[:, None] * (s[:, None] + self._loss) + self._own**2)

    def _push(self, s: ComplexArray) -> ComplexArray:
        """Z, (values, bodies)."""
        s = s[:, None]
        spring, inert = self._stiffness + self._damping * s, self._body * s**2
        return np.asarray(spring * inert / (inert + spring))

    def _compliance(self, inverse: ComplexArray) -> ComplexArray:
        """P' (m `inverse`) P, (values, bodies, bodies), of the inverse, (values, modes), of each mode."""
        bodies = len(self._body)
        pairs = (self._at[:, :, None] * self._at[:, None, :]).reshape(self._count, -1)
        return (inverse @ (pairs / self._mass[:, None])).reshape(len(inverse), bodies, bodies)

    def _matrix(self, s: ComplexArray) -> ComplexArray:
        """Z^-1 + P' D^-1 P, (values, bodies, bodies)."""
        at = s[:, None]
        alone = 1 / (self._stiffness + self._damping * at) + 1 / (self._body * at**2)
        return np.asarray(
            alone[:, :, None] * np.eye(len(self._body)) + self._compliance(1 / self._dynamic(s))
        )

    def _growth(self, s: ComplexArray, modes: IntArray) -> ComplexArray:
        """The characteristic polynomial's derivative over its value, (values,), of modes that are coupled."""
        dynamic, slope, at = self._dynamic(s), 2 * s[:, None] + self._loss, s[:, None]
        softer = self._damping / (self._stiffness + self._damping * at)
        alone = softer / (self._stiffness + self._damping * at) + 2 / (self._body * at**3)
        changes = alone[:, :, None] * np.eye(len(self._body)) + self._compliance(slope / dynamic**2)
        trace = np.trace(np.linalg.solve(self._matrix(s), changes), axis1=1, axis2=2)
        own = (softer + 2 / at).sum(axis=1)
        return np.asarray((slope / dynamic)[:, modes].sum(axis=1) + own - trace)

    def _poles(self, modes: IntArray) -> ComplexArray:
        """Poles that these modes and the bodies have together, one of each pair."""
        lowest = modes[np.argsort(self._own[modes])]
        lowest, above = lowest[:_LOWEST], lowest[_LOWEST:]
        if not len(above):
            return self._full(lowest)
        bare = self._bare()[above]
        pushed = ((self._at[above] ** 2) * self._push(bare)).sum(axis=1) / self._mass[above]
        s = np.concatenate([self._full(lowest), bare - pushed / (2 * bare + self._loss[above])])
        moving = np.arange(len(s))
        for _ in range(_ROUNDS):
            found = np.asarray(s[moving] * _BESIDE, dtype=np.complex128)
            others = np.concatenate([s, s[s.imag > 0].conj()])
            apart = found[:, None] - others
            apart[np.arange(len(moving)), moving] = np.inf
            step = 1 / (self._growth(found, modes) - (1 / apart).sum(axis=1))
            found = found - step
            # A real pole that left the axis by rounding would be repelled by its own image.
            s[moving] = np.where(np.abs(found.imag) < _REAL * np.abs(found), found.real, found)
            moving = moving[np.abs(step) > _FOUND * np.abs(found)]
            if not len(moving):
                break
        # One that is missed, found twice, or of a pair that is real after all, spoils the sum of all.
        trace = -self._loss[modes].sum() - (self._damping / self._body).sum()
        trace -= (self._at[modes] ** 2 * self._damping / self._mass[modes, None]).sum()
        apart = s.real @ np.where(s.imag > 0, 2.0, 1.0) - trace
        return s if abs(apart) < _WHOLE * np.abs(s).sum() else self._full(modes)

    def _full(self, modes: IntArray) -> ComplexArray:
        """`_poles`, by the eigenvalues of the whole matrix."""
        at, count, n = self._at[modes], len(modes), len(modes) + len(self._body)
        across = np.concatenate([at, -np.eye(len(self._body))])
        mass = np.concatenate([self._mass[modes], self._body])[:, None]
        matrix = np.zeros((2 * n, 2 * n))
        matrix[:n, n:] = np.eye(n)
        matrix[n:, :n] = -(across * self._stiffness) @ across.T / mass
        matrix[n:, n:] = -(across * self._damping) @ across.T / mass
        rows = np.arange(count)
        matrix[n + rows, rows] -= self._own[modes] ** 2
        matrix[n + rows, n + rows] -= self._loss[modes]
        values = np.linalg.eigvals(matrix).astype(np.complex128)
        return values[values.imag >= 0]


def _null(matrices: ComplexArray) -> ComplexArray:
    """What each of matrices, (values, n, n), makes nothing of, (values, n)."""
    if matrices.shape[1] < 2:
        return np.ones(matrices.shape[:2], dtype=np.complex128)
    return np.asarray(np.linalg.svd(matrices)[2][:, -1].conj())


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
