"""The modes of a table from plays at many points: one set of poles for all points.

A play is one period of a multisine, of one patch or of several at once, begun whenever the play
before it ended. Its spectra obey

    velocity = sum over patches of linear volts x (sum of r / (s - p) + conj + constant + slope s)
               + sum of t / (s - p) + conj + constant

at every line, excited or not: the second row is the ringing at the start of the period less that at its
end. So no settling is needed, and patches that play together need not be separated beforehand. Given poles
and linear volts this is linear in all other unknowns; the poles and the hysteresis of each patch are found
by variable projection over all points (Golub and Pereyra, Inverse Problems 19, 2003, with Kaufman's
Jacobian).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from haploop.instruments import DataError
from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = ["Modes", "Plays", "columns_of", "fit_modes", "stack"]

_STEPS = 12
"""Largest number of refinement steps."""
_CONVERGED = 1e-3
"""Relative decrease of the squared residual, as foreseen, below which refinement ends."""
_STRONGEST = 16
"""Singular vectors of the points that contain nearly all power: about one for each mode."""
_FEW, _MORE = 2, 6
"""Random mixtures of these in the first and the last fit, for each set of drives."""
_FARTHEST = 0.2
"""Largest step of the logarithm of a decay or a frequency."""
_DAMPINGS = (0.003, 0.008, 0.02)
"""Damping ratios of the candidate poles for the residual of a fit."""
_PLACES, _BEYOND = 500, 1.3
"""Number of candidate frequencies, and the highest one over the band's upper end."""
_AT_ONCE, _APART = 3, 0.02
"""Largest number of poles added at once, and their smallest relative distance in frequency."""
_PENALTY = 25.0
"""Gain per real parameter, over the mean squared residual, required to add a pole: a pole with a free
frequency fits more noise than a linear parameter, and a real mode gains hundreds."""
_KEEP = 5.0
"""Gain, as `_PENALTY`, below which a pole is removed again: its frequency is no longer searched for."""
_MOST = 40
"""Largest number of poles."""
_FLAT = 1e-12
"""Slope, over the largest at the start, at which a bound is left alone."""
_ALIKE = 1e-13
"""Regularisation that keeps the normal equations of coincident columns positive definite."""


@dataclass(frozen=True, eq=False)
class Plays:
    """The same drives, played while the laser looked at several points.

    `f` is (lines,) Hz: all lines of the band. `operators` is (patches, operators, lines): for each patch
    that played, the spectrum of its volts and, where hysteresis is modelled, of the volts after play
    operators of rising half-width, and last of their square. `velocity` is (lines, points) m/s.
    """

    f: FloatArray
    patches: tuple[int, ...]
    operators: ComplexArray
    velocity: ComplexArray


@dataclass(frozen=True, eq=False)
class Modes:
    """Shared poles (rad/s), and the weights (patches, operators) that make up each patch's linear volts.

    No play operator has a negative weight; the square, which bends the loop, may have.
    """

    poles: ComplexArray
    weights: FloatArray

    def shares(self, plays: Plays) -> tuple[FloatArray, FloatArray]:
        """Real unknowns (patches, unknowns, points), and the relative residual (points,)."""
        basis = _Basis.of(self.poles, self.weights, plays)
        found, left = basis.solution(stack(plays.velocity))
        size = np.linalg.norm(stack(plays.velocity), axis=0)
        each = basis.response.shape[1]
        count = len(plays.patches)
        return found[: count * each].reshape(count, each, -1), np.linalg.norm(left, axis=0) / size

    def shift(self, plays: Plays) -> float:
        """Relative shift common to all poles, from later plays."""
        shifted, total = self, 1.0
        for _ in range(2):
            normal, gradient = _Fitted.of(shifted, plays).linear()
            poles = slice(0, 2 * len(self.poles))
            total *= 1 + float(gradient[poles].sum() / normal[poles, poles].sum())
            shifted = Modes(self.poles * total, self.weights)
        return total - 1

    def velocity(self, shares: FloatArray, frequencies: FloatArray) -> ComplexArray:
        """(..., frequencies) m/s per linear volt, from unknowns (..., unknowns)."""
        return np.asarray(shares @ columns_of(self.poles, frequencies)[0].T)


def fit_modes(plays: Sequence[Plays], patches: int) -> Modes:
    """Poles that all plays share and the law of each patch's hysteresis, up to its scale.

    It begins with nothing, and adds poles where they explain most of what is left, for as long as
    that leaves clearly less. Raises DataError when nothing moved at all.
    """
    few = [_mixed(one, _FEW) for one in plays]
    weights = np.zeros((patches, plays[0].operators.shape[1]))
    weights[:, 0] = 1.0
    modes, cost = Modes(np.zeros(0, dtype=np.complex128), weights), np.inf
    # Real parameters that a pole brings, over the real numbers that were measured, of each mixture.
    each = max(2 * (len(one.patches) + 1) / (2 * len(one.f)) for one in plays)
    count, candidates = _AT_ONCE, _Candidates.of(plays[0].f)
    while len(modes.poles) < _MOST:
        added = _missing(modes, few, candidates)[:count]
        if not len(added):
            raise DataError("Nothing moved while it was played: check the laser's focus and aim.")
        steps = _STEPS if count == 1 else 3
        grown, now = _refined(Modes(np.append(modes.poles, added), modes.weights), few, steps)
        if count > 1 and now > 0.5 * cost:
            # Near the end, what falls may be the law's doing and not the poles'.
            modes, cost = _refined(modes, few, _STEPS)
            count = 1
        elif count == 1 and now > (1 - _PENALTY * each) * cost:
            break
        else:
            modes, cost = grown, now
    modes = _pruned(modes, cost, few, _KEEP * each)
    return _refined(modes, [_mixed(one, _MORE) for one in plays], _STEPS)[0]


def _pruned(modes: Modes, cost: float, plays: Sequence[Plays], worth: float) -> Modes:
    """Remove the poles that the others can replace: those added early, before the others had converged."""
    while len(modes.poles) > 1:
        losses = np.sum([_losses(modes, one) for one in plays], axis=0)
        fewer = Modes(np.delete(modes.poles, int(np.argmin(losses))), modes.weights)
        tried, now = _refined(fewer, plays, _STEPS)
        if now > (1 + worth) * cost:
            break
        modes, cost = tried, now
    return modes


def _losses(modes: Modes, plays: Plays) -> FloatArray:
    """(poles,): increase of the squared residual on removal of each pole, with the others fixed."""
    basis = _Basis.of(modes.poles, modes.weights, plays)
    found = basis.solution(stack(plays.velocity))[0] * basis.norms[:, None]
    inverse = np.linalg.inv(basis.upper)
    n, each = len(modes.poles), basis.response.shape[1]
    starts = np.arange(len(plays.patches) + 1) * each
    losses = np.empty(n)
    for k in range(n):
        own = np.concatenate([starts + k, starts + n + k])
        spread = inverse[own] @ inverse[own].T
        losses[k] = float(np.sum(found[own] * np.linalg.lstsq(spread, found[own], rcond=None)[0]))
    return losses


def _refined(modes: Modes, plays: Sequence[Plays], steps: int) -> tuple[Modes, float]:
    """Refine modes to a minimum of the squared residual near the given ones; returns both."""
    best, cost, tried, damping = modes, np.inf, modes, 1e-3
    for left in range(steps, -1, -1):
        fitted = [_Fitted.of(tried, one) for one in plays]
        now = sum(float((one.left**2).sum()) for one in fitted)
        better = now < cost
        if better:
            best, cost = tried, now
        if left == 0:
            break
        if better:
            linear = [one.linear() for one in fitted]
            normal = np.sum([part[0] for part in linear], axis=0)
            gradient = np.sum([part[1] for part in linear], axis=0)
            damping /= 10
        else:
            damping = max(30 * damping, 1e-4)
        tried, step = _stepped(best, normal, gradient, damping)
        if 2 * step @ gradient - step @ normal @ step < _CONVERGED * cost:
            break
    return best, cost


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Poles (dampings, places), and for each damping the responses (lines, places) and their power.

    In single precision, which halves memory: they are only compared.
    """

    poles: ComplexArray
    shapes: tuple[NDArray[np.complex64], ...]
    sizes: tuple[NDArray[np.float32], ...]

    @classmethod
    def of(cls, f: FloatArray) -> _Candidates:
        places = 2 * np.pi * np.linspace(f[0], _BEYOND * f[-1], _PLACES)
        poles = places * (1j - np.array(_DAMPINGS)[:, None])
        shapes = tuple((1 / (2j * np.pi * f[:, None] - row)).astype(np.complex64) for row in poles)
        return cls(poles, shapes, tuple(np.abs(shape) ** 2 for shape in shapes))


def _missing(modes: Modes, plays: Sequence[Plays], candidates: _Candidates) -> ComplexArray:
    """Poles (rad/s) that explain most of the residual of the modes, strongest first."""
    explained: FloatArray = np.zeros(candidates.poles.shape)
    for one in plays:
        basis = _Basis.of(modes.poles, modes.weights, one)
        rest = basis.solution(stack(one.velocity))[1]
        left = rest[: len(one.f)] + 1j * rest[len(one.f) :]
        for linear_volts in basis.linear_volts:
            share = (left.conj() * linear_volts[:, None]).T.astype(np.complex64)
            power = (np.abs(linear_volts) ** 2).astype(np.float32)
            for k, (shape, size) in enumerate(zip(candidates.shapes, candidates.sizes, strict=True)):
                explained[k] += (np.abs(share @ shape) ** 2).sum(axis=0) / (power @ size)
    places = candidates.poles[0].imag
    best = explained.max(axis=0)
    poles: list[complex] = []
    while len(poles) < _AT_ONCE:
        place = int(np.argmax(best))
        if best[place] <= 0.1 * explained.max():
            break
        poles.append(complex(candidates.poles[int(np.argmax(explained[:, place])), place]))
        best = np.where(np.abs(places / places[place] - 1) < _APART, 0.0, best)
    return np.array(poles)


def _stepped(
    modes: Modes, normal: FloatArray, gradient: FloatArray, damping: float
) -> tuple[Modes, FloatArray]:
    """One Gauss-Newton step, bounded: a play operator's weight stays positive, logarithms move a little."""
    p, w = modes.poles, modes.weights
    count = 2 * len(p)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12 * np.diag(normal).max()))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    scaled = (vectors * (np.maximum(values, 0.0) + damping + 1e-9)) @ vectors.T
    lowest = -w[:, 1:] - 1e-9
    lowest[:, -1:] = -1.0
    low = np.concatenate([np.full(count, -_FARTHEST), lowest.ravel()])
    high = np.concatenate([np.full(count, _FARTHEST), np.ones(w[:, 1:].size)])
    step = np.clip(_bounded(scaled, gradient / scale, low * scale, high * scale) / scale, low, high)
    decay = -p.real * np.exp(step[: len(p)])
    turn = p.imag * np.exp(step[len(p) : count])
    further = w[:, 1:] + step[count:].reshape(len(w), -1)
    further[:, :-1] = np.maximum(further[:, :-1], 0.0)
    # The law's scale is free: of the volts themselves there is one part.
    return Modes(-decay + 1j * turn, np.concatenate([w[:, :1], further], axis=1)), step


def _bounded(normal: FloatArray, gradient: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the minimum of x'Nx / 2 - g'x within bounds that hold 0 between them, for a definite N.

    Bounded-variable least squares (Stark and Parker, Computational Statistics 10, 1995) on the normal
    equations: scipy's decomposes all rows anew for each set of free variables, which took ten times as long.
    """
    x = np.linalg.solve(normal, gradient)
    fixed = (x < low) | (x > high)
    x = np.clip(x, low, high)
    for _ in range(10 * len(x)):
        free = np.flatnonzero(~fixed)
        own = gradient[free] - normal[np.ix_(free, fixed)] @ x[fixed]
        ahead = np.linalg.solve(normal[np.ix_(free, free)], own) - x[free]
        end = np.where(ahead > 0, high[free], low[free])
        room = np.divide(end - x[free], ahead, out=np.full(len(free), np.inf), where=ahead != 0)
        if len(room) and room.min() < 1:
            first = int(np.argmin(room))
            x[free] += room[first] * ahead
            x[free[first]] = end[first]
            fixed[free[first]] = True
            continue
        x[free] += ahead
        downhill = (gradient - normal @ x) * np.where(x >= high, -1.0, 1.0)
        inwards = np.where(fixed, downhill, -np.inf)
        best = int(np.argmax(inwards))
        if inwards[best] <= _FLAT * np.abs(gradient).max():
            break
        fixed[best] = False
    return np.asarray(x)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Modes with the least squares of all other unknowns, (unknowns, points), and what is `left`."""

    modes: Modes
    plays: Plays
    basis: _Basis
    found: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, modes: Modes, plays: Plays) -> _Fitted:
        basis = _Basis.of(modes.poles, modes.weights, plays)
        return cls(modes, plays, basis, *basis.solution(stack(plays.velocity)))

    def linear(self) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and gradient by logarithms of decay and frequency, and weights."""
        p, basis, plays = self.modes.poles, self.basis, self.plays
        near, mirror = (fraction * fraction for fraction in _fractions(p, plays.f))
        each, n, weights = basis.response.shape[1], len(p), self.modes.weights.shape[1] - 1
        normal = np.zeros((2 * n + len(self.modes.weights) * weights,) * 2)
        gradient = np.zeros(len(normal))
        # Only those of the patches that played.
        laws = np.add.outer(2 * n + np.array(plays.patches) * weights, np.arange(weights))
        own = np.concatenate([np.arange(2 * n), laws.ravel()])
        drives = np.array([*basis.linear_volts, np.ones(len(plays.f))]).T
        for shares, rest in zip(self.found.T, self.left.T, strict=True):
            ranges = np.array([shares[k * each : k * each + 2 * n] for k in range(drives.shape[1])])
            one = (drives @ (ranges[:, :n] + 1j * ranges[:, n:])) * near
            other = (drives @ (ranges[:, :n] - 1j * ranges[:, n:])) * mirror
            change = [(one + other) * p.real, 1j * (one - other) * p.imag]
            for k, operators in enumerate(plays.operators):
                change.append((operators[1:] * (basis.response @ shares[k * each : (k + 1) * each])).T)
            columns = stack(np.concatenate(change, axis=1))
            within = basis.within(columns)
            normal[np.ix_(own, own)] += columns.T @ columns - within.T @ within
            gradient[own] += columns.T @ rest
        return normal, gradient


@dataclass(frozen=True, eq=False)
class _Basis:
    """Columns of unit length for given poles and linear volts, patch by patch, then what rang.

    With the triangle of their normal equations, which are ten times as fast as orthogonal columns would
    be; what they cost in digits one refinement gives back (Bjorck, Linear Algebra Appl. 88, 1987).
    """

    linear_volts: ComplexArray
    response: ComplexArray
    columns: FloatArray
    upper: FloatArray
    norms: FloatArray

    @classmethod
    def of(cls, poles: ComplexArray, weights: FloatArray, plays: Plays) -> _Basis:
        response, ringing = columns_of(poles, plays.f)
        linear_volts = np.einsum("pr,prl->pl", weights[list(plays.patches)], plays.operators)
        columns = stack(np.concatenate([*(x[:, None] * response for x in linear_volts), ringing], axis=1))
        norms = np.linalg.norm(columns, axis=0)
        columns /= norms
        # Of columns that coincide, least squares of the least norm.
        upper = scipy.linalg.cholesky(columns.T @ columns + _ALIKE * np.eye(len(norms)))
        return cls(linear_volts, response, columns, upper, norms)

    def within(self, values: FloatArray) -> FloatArray:
        """(columns, ...): what of `values` (rows, ...) the columns make, in coordinates of unit length."""
        return np.asarray(scipy.linalg.solve_triangular(self.upper, self.columns.T @ values, trans="T"))

    def solution(self, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
        found, left = np.zeros((len(self.norms), measured.shape[1])), measured
        for _ in range(2):
            found += scipy.linalg.solve_triangular(self.upper, self.within(left))
            left = measured - self.columns @ found
        return found / self.norms[:, None], left


def columns_of(poles: ComplexArray, f: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Columns (lines, unknowns) of the real unknowns of a response, and of those of what rings."""
    s = 2j * np.pi * np.asarray(f)[:, None]
    near, mirror = _fractions(poles, f)
    pairs = np.concatenate([near + mirror, 1j * (near - mirror)], axis=1)
    one = np.ones_like(s)
    return np.concatenate([pairs, one, s], axis=1), np.concatenate([pairs, one, 1j * one], axis=1)


def _fractions(poles: ComplexArray, f: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """1 / (s - p) and 1 / (s - conj p), (lines, poles). In real numbers: a complex division takes five times
    as long.
    """
    both = []
    for imag in (poles.imag, -poles.imag):
        along = 2 * np.pi * np.asarray(f)[:, None] - imag
        inverse = 1 / (poles.real**2 + along**2)
        fraction = np.empty(along.shape, dtype=np.complex128)
        np.multiply(inverse, -poles.real, out=fraction.real)
        np.multiply(inverse, -along, out=fraction.imag)
        both.append(fraction)
    return both[0], both[1]


def _mixed(plays: Plays, count: int) -> Plays:
    """A few combinations of points. They have the table's poles, and each shows every mode."""
    left, sizes, _ = np.linalg.svd(stack(plays.velocity), full_matrices=False)
    strongest = (left * sizes)[:, :_STRONGEST]
    many = strongest.shape[1]
    mixing = np.linalg.qr(np.random.default_rng(0).standard_normal((many, many)))[0][:, :count]
    mixed, half = strongest @ mixing, len(plays.f)
    return Plays(plays.f, plays.patches, plays.operators, mixed[:half] + 1j * mixed[half:])


def stack(values: ComplexArray) -> FloatArray:
    """Real parts (lines, ...) above imaginary parts."""
    return np.concatenate([values.real, values.imag])
