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
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.errors import DataError
from .terms import moved, rows, terms_of

_STEPS = 12
"""Largest number of refinement steps."""
_SETTLED, _CONVERGED = 1e-2, 1e-3
"""Relative decrease of the squared residual, as foreseen, below which refinement ends: during the search for
poles, and at the end."""
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
_TONE = 0.1
"""Half-power width of a pole, over the lines' spacing, below which it is a tone from elsewhere."""
_FLAT = 1e-12
"""Slope, over the largest at the start, at which a bound is left alone."""
_ALIKE = 1e-13
"""Regularisation that keeps the normal equations of coincident columns positive definite."""


@dataclass(frozen=True, eq=False)
class Plays:
    """The same drives, played while the laser looked at several points.

    `f` is (lines,) Hz: all lines of the band. `operators` is (patches, operators, lines): for each patch
    that played, the spectrum of its volts and, where hysteresis is modelled, of the volts after play
    operators of rising half-width, and last of their square. `velocity` is (lines, points) m/s. What rings
    at the start and the end of a period is a part of it if it `rings`; a response that was measured from rest
    to rest has no such part.
    """

    f: FloatArray
    patches: tuple[int, ...]
    operators: ComplexArray
    velocity: ComplexArray
    rings: bool = True


@dataclass(frozen=True, eq=False)
class Modes:
    """Shared poles (rad/s), and the weights (patches, operators) that make up each patch's linear volts.

    No play operator has a negative weight; the square, which bends the loop, may have.
    """

    poles: ComplexArray
    weights: FloatArray

    def shares(self, plays: Plays) -> tuple[FloatArray, FloatArray]:
        """Real unknowns (patches, unknowns, points), and the relative residual (points,)."""
        fitted = _Fitted.of(self, plays)
        count, each = len(plays.patches), len(fitted.terms)
        left = np.linalg.norm(fitted.left, axis=1) / np.linalg.norm(plays.velocity, axis=0)
        shares = fitted.found[: count * each].reshape(count, each, -1).copy()
        hz = np.abs(self.poles) / (2 * np.pi)
        # A narrow pole beyond the band stands for what is far away, and is no tone.
        tones = self.tones(plays.f) & (hz > plays.f[0]) & (hz < plays.f[-1])
        shares[:, : 2 * len(self.poles)][:, np.tile(tones, 2)] = 0.0
        return shares, left

    def tones(self, f: FloatArray) -> BoolArray:
        """(poles,) True for what is too narrow to be a mode, at lines `f` (Hz): a tone from elsewhere.

        Mains hum, say. It rings, and has no part in the response.
        """
        return np.asarray(-self.poles.real / np.pi < _TONE * float(f[1] - f[0]))

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
        return np.asarray(shares @ terms_of(self.poles, frequencies)[0])


def fit_modes(plays: Sequence[Plays], patches: int) -> Modes:
    """Poles that all plays share and the law of each patch's hysteresis, up to its scale.

    It begins with nothing, and adds poles where they explain most of what is left, for as long as
    that leaves clearly less. Raises DataError when nothing moved at all.
    """
    few = [_mixed(one, _FEW) for one in plays]
    weights = np.zeros((patches, plays[0].operators.shape[1]))
    weights[:, 0] = 1.0
    best, cost = _Fit.of(Modes(np.zeros(0, dtype=np.complex128), weights), few), np.inf
    # Real parameters that a pole brings, over the real numbers that were measured, of each mixture.
    each = max(2 * (len(one.patches) + 1) / (2 * len(one.f)) for one in plays)
    count, candidates = _AT_ONCE, _Candidates.of(plays[0].f)
    while len(best.modes.poles) < _MOST:
        added = _missing(best, candidates)[:count]
        if not len(added):
            raise DataError("Nothing moved while it was played: check the laser's focus and aim.")
        modes = Modes(np.append(best.modes.poles, added), best.modes.weights)
        grown = _refined(_Fit.of(modes, few), _STEPS if count == 1 else 3)
        if count > 1 and grown.cost > 0.5 * cost:
            # Near the end, what falls may be the law's doing and not the poles'.
            best, count = _refined(best, _STEPS), 1
            cost = best.cost
        elif count == 1 and grown.cost > (1 - _PENALTY * each) * cost:
            break
        else:
            best, cost = grown, grown.cost
    modes = _pruned(best, _KEEP * each).modes
    return _refined(_Fit.of(modes, [_mixed(one, _MORE) for one in plays]), _STEPS, _CONVERGED).modes


def _pruned(best: _Fit, worth: float) -> _Fit:
    """Remove the poles that the others can replace: those added early, before the others had converged."""
    while len(best.modes.poles) > 1:
        losses = np.sum([one.losses() for one in best.parts], axis=0)
        fewer = Modes(np.delete(best.modes.poles, int(np.argmin(losses))), best.modes.weights)
        tried = _refined(_Fit.of(fewer, [one.plays for one in best.parts]), _STEPS)
        if tried.cost > (1 + worth) * best.cost:
            break
        best = tried
    return best


def _refined(best: _Fit, steps: int, settled: float = _SETTLED) -> _Fit:
    """Refine modes to a minimum of the squared residual near the given ones."""
    damping, linear = 1e-4, None
    for _ in range(steps):
        normal, gradient = linear = linear or best.linear()
        modes, step = _stepped(best.modes, normal, gradient, damping)
        if 2 * step @ gradient - step @ normal @ step < settled * best.cost:
            break
        tried = _Fit.of(modes, [one.plays for one in best.parts])
        if tried.cost < best.cost:
            best, damping, linear = tried, damping / 10, None
        else:
            damping = max(30 * damping, 1e-4)
    return best


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
        shapes, sizes = [], []
        for row in poles:
            inverse = (2j * np.pi * f[:, None] - row).astype(np.complex64)
            size = 1 / (inverse.real**2 + inverse.imag**2)
            shapes.append(inverse.conj() * size)
            sizes.append(size)
        return cls(poles, tuple(shapes), tuple(sizes))


def _missing(fit: _Fit, candidates: _Candidates) -> ComplexArray:
    """Poles (rad/s) that explain most of the residual of the modes, strongest first."""
    explained: FloatArray = np.zeros(candidates.poles.shape)
    for one in fit.parts:
        left = one.left.view(np.complex128)
        for linear_volts in one.linear_volts:
            share = (left.conj() * linear_volts).astype(np.complex64)
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
    """Modes with the least squares of all other unknowns, `found` (unknowns, points), and what is `left`.

    Rows are the real and imaginary parts of the lines by turns: complex numbers seen as real ones, which
    needs no copy. `terms` are (unknowns, lines), one patch's without its volts, `columns` (unknowns, rows)
    of all patches and what rang, `left` (points, rows). `upper` is the triangle of the columns' normal
    equations at unit length, which are ten times as fast as orthogonal columns would be; what they cost in
    digits one refinement gives back (Bjorck, Linear Algebra Appl. 88, 1987).
    """

    modes: Modes
    plays: Plays
    linear_volts: ComplexArray
    terms: ComplexArray
    columns: FloatArray
    norms: FloatArray
    upper: FloatArray
    found: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, modes: Modes, plays: Plays) -> _Fitted:
        terms, ringing = terms_of(modes.poles, plays.f)
        ringing = ringing if plays.rings else ringing[:0]
        linear_volts = np.einsum("pr,prl->pl", modes.weights[list(plays.patches)], plays.operators)
        columns = np.concatenate([*(x * terms for x in linear_volts), ringing]).view(np.float64)
        gram = columns @ columns.T
        norms = np.sqrt(np.diag(gram))
        # Of columns that coincide, least squares of the least norm.
        upper = scipy.linalg.cholesky(gram / np.outer(norms, norms) + _ALIKE * np.eye(len(norms)))
        measured = rows(plays.velocity.T)
        found, left = np.zeros((len(norms), len(measured))), measured
        for _ in range(2):
            within = _solved(upper, (columns @ left.T) / norms[:, None], transposed=True)
            found += _solved(upper, within) / norms[:, None]
            left = measured - found.T @ columns
        return cls(modes, plays, linear_volts, terms, columns, norms, upper, found, left)

    def losses(self) -> FloatArray:
        """(poles,): increase of the squared residual on removal of each pole, with the others fixed."""
        inverse = scipy.linalg.cho_solve((self.upper, False), np.eye(len(self.norms)))
        found, each, n = self.found * self.norms[:, None], len(self.terms), len(self.modes.poles)
        starts = np.arange(len(self.plays.patches) + self.plays.rings) * each
        losses = np.empty(n)
        for k in range(n):
            own = np.concatenate([starts + k, starts + n + k])
            spread = inverse[np.ix_(own, own)]
            losses[k] = float(np.sum(found[own] * np.linalg.lstsq(spread, found[own], rcond=None)[0]))
        return losses

    def linear(self) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and gradient by logarithms of decay and frequency, and weights."""
        p, plays, n = self.modes.poles, self.plays, len(self.modes.poles)
        each, weights = len(self.terms), self.modes.weights.shape[1] - 1
        normal = np.zeros((2 * n + len(self.modes.weights) * weights,) * 2)
        gradient = np.zeros(len(normal))
        # Only those of the patches that played.
        laws = np.add.outer(2 * n + np.array(plays.patches) * weights, np.arange(weights))
        own = np.concatenate([np.arange(2 * n), laws.ravel()])
        drives = np.concatenate([self.linear_volts, np.ones((int(plays.rings), len(plays.f)))])
        for point, rest in zip(self.found.T, self.left, strict=True):
            shares = point.reshape(len(drives), each)
            change = [*moved(p, shares[:, : 2 * n], drives, plays.f)]
            for own_share, operators in zip(shares, plays.operators, strict=False):
                response = (own_share @ rows(self.terms)).view(np.complex128)
                change.append(operators[1:] * response)
            columns = rows(np.concatenate(change))
            within = _solved(self.upper, (self.columns @ columns.T) / self.norms[:, None], transposed=True)
            normal[np.ix_(own, own)] += columns @ columns.T - within.T @ within
            gradient[own] += columns @ rest
        return normal, gradient


@dataclass(frozen=True, eq=False)
class _Fit:
    """The same modes fitted to several plays, and the squared residual of all."""

    modes: Modes
    parts: tuple[_Fitted, ...]
    cost: float

    @classmethod
    def of(cls, modes: Modes, plays: Sequence[Plays]) -> _Fit:
        parts = tuple(_Fitted.of(modes, one) for one in plays)
        return cls(modes, parts, sum(float((one.left**2).sum()) for one in parts))

    def linear(self) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and gradient, as `_Fitted.linear`."""
        normal, gradient = zip(*(one.linear() for one in self.parts), strict=True)
        return np.sum(normal, axis=0), np.sum(gradient, axis=0)


def _solved(upper: FloatArray, values: FloatArray, *, transposed: bool = False) -> FloatArray:
    return np.asarray(
        scipy.linalg.solve_triangular(upper, values, trans="T" if transposed else "N", check_finite=False)
    )


def _mixed(plays: Plays, count: int) -> Plays:
    """A few combinations of points. They have the table's poles, and each shows every mode."""
    _, sizes, right = np.linalg.svd(rows(plays.velocity.T), full_matrices=False)
    strongest = (sizes[:, None] * right)[:_STRONGEST]
    many = len(strongest)
    mixing = np.linalg.qr(np.random.default_rng(0).standard_normal((many, many)))[0][:, :count]
    return replace(plays, velocity=(mixing.T @ strongest).view(np.complex128).T)
