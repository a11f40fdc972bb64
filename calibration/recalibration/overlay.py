"""Lay a model over a new response mode by mode: each mode with its own frequency and damping.

Temperature moves all modes of a table alike; a boundary that gives way, or a body on it, moves each by its
own amount. So every mode has its own change, which is drawn towards the common one, and a gain is common
to all. Mode shapes do not drift: a response whose modes changed in strength is that of another place or
patch, and leaves a residual.

What rests on the table is told from a drift by the modes' damping. A finger, a palm or a thing that is left
there takes energy out of every mode, of each as its shape is at that place: some modes are damped a lot more,
others hardly, and none is damped less. A drift moves frequencies, or changes all dampings by one factor, or
some up and others down. So where dampings have risen by unlike amounts, and none has fallen by a comparable
one, something may rest on the table. A boundary that damps some modes more does the same. No response tells
the two apart; a person can, so that one is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...base.arrays import ComplexArray, FloatArray, IntArray
from ..band import BAND
from ..model import Model, pole_slopes

if TYPE_CHECKING:
    from .drift import Verdict


_FURTHEST = 0.12
"""Largest common shift (logarithm) in the search."""
_GRID = 0.0025
"""Step of the searches: a quarter of a resonance's half-width at 1 % damping."""
_APART = 0.06
"""Largest shift of one mode relative to the common one (logarithm) in the search."""
_SPREAD, _DAMPING_SPREAD, _MISFIT = 0.05, 0.3, 0.1
"""Standard deviations of a mode's own shift and damping (logarithms) about the common ones, and of the
relative residual: with these a mode moves by 5 % where the response demands it, and damping does not stand in
for a strength that changed."""
_CLOSE = 0.01
"""As `_MISFIT`, where a mode's own damping must not stand in the common factor: of tables on which all
dampings changed by half, or each by 20 %, it is right to 1 % so, and was off by up to 10 % (88 drifts)."""
_DAMPINGS = np.log([0.6, 0.8, 1.0, 1.25, 1.7])
"""Changes of a mode's damping in the search."""
_ROUNDS = 4
_SEARCHED = 2000
"""Lines that the searches look at, at most: they only have to find the valley, and look a thousand times."""
_TOGETHER = 0.5
"""Distance of two poles, over their decay, within which they move as one: no response tells them apart."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """A model with every mode moved to where a new response has it; arrays are (poles,)."""

    model: Model
    """The moved model."""
    shift: FloatArray
    """Relative change of each pole's frequency."""
    damping: FloatArray
    """Factor of each pole's damping ratio."""
    gain: float
    """Factor of the response common to all modes."""
    factor: float
    """The same, of a fit that follows each mode's own damping as far as the response says."""
    dampings: FloatArray
    """Factor of each pole's damping ratio, of that fit."""
    left: float
    """`residual` of that fit."""
    unsure: FloatArray
    """By how much of its logarithm what that fit leaves could have changed each of `dampings`, (poles,)."""
    weight: FloatArray
    """Peak of each pole's resonance over that of the strongest; 0 where no line shows it."""
    residual: float
    """Rms of what no drift explains, over that of the response."""


def lay_over(model: Model, f: FloatArray, measured: ComplexArray) -> Overlay:
    """Fit the changes of a model's modes to a response `measured` (m/s per V) at `f` (Hz).

    A response of narrow resonances has many false minima, so that the common shift and then each mode's own,
    the strongest first, are searched on a grid before all are refined together, from two starts: the best
    common shift, and none.
    """
    groups = _groups(model)
    problem, coarse = (
        _Problem.of(model, f[::every], measured[::every], groups) for every in (1, -(-len(f) // _SEARCHED))
    )
    starts = {coarse.common_start(), 0.0}
    found = min((problem.refined(coarse.searched(start)) for start in starts), key=problem.cost)
    closer = replace(problem, misfit=_CLOSE)
    close = closer.refined(found)
    return problem.overlay(found, close, closer.reach(close))


@dataclass(frozen=True, eq=False)
class _Problem:
    """`x` is the common shift, damping and gain, then each group's own shift and damping (logarithms)."""

    model: Model
    f: FloatArray
    measured: ComplexArray
    """(lines,): the response over its size."""
    size: float
    groups: IntArray
    """(poles,): the group that a pole belongs to."""
    misfit: float = _MISFIT

    @classmethod
    def of(cls, model: Model, f: FloatArray, measured: ComplexArray, groups: IntArray) -> _Problem:
        size = float(np.linalg.norm(measured))
        return cls(model, f, measured / size, size, groups)

    @property
    def count(self) -> int:
        return int(self.groups.max()) + 1

    def common_start(self) -> float:
        """The common shift with the least residual, on a grid."""
        shifts = _grid(_FURTHEST)
        every = self._rest() + self._part(np.arange(len(self.groups)), shifts, 0.0)
        left = [float(np.linalg.norm(self.measured - self._gain(shape) * shape)) for shape in every]
        return float(shifts[int(np.argmin(left))])

    def searched(self, start: float) -> FloatArray:
        """`x` after a search of each group's own shift and damping, in rounds, the strongest group first."""
        x = np.zeros(3 + 2 * self.count)
        x[0] = start
        own = [np.flatnonzero(self.groups == k) for k in range(self.count)]
        rest = self._rest()
        shifts = _grid(_APART)
        every = [np.array([self._part(poles, start + shifts, one) for one in _DAMPINGS]) for poles in own]
        middle = len(_DAMPINGS) // 2, len(shifts) // 2
        parts = [tried[middle] for tried in every]
        prior = (shifts / _SPREAD) ** 2 + (_DAMPINGS[:, None] / _DAMPING_SPREAD) ** 2
        power = [(tried.view(np.float32) ** 2).sum(axis=-1) for tried in every]
        order = np.argsort([-np.linalg.norm(part) for part in parts])
        for _ in range(_ROUNDS):
            whole = rest + np.sum(parts, axis=0)
            gain = self._gain(whole)
            for k in order:
                others = whole - parts[k]
                missing = (self.measured - gain * others).conj().astype(np.complex64)
                # |missing - gain tried|^2 without the constant |missing|^2
                left = gain**2 * power[k] - 2 * gain * (every[k] @ missing).real
                b, a = np.unravel_index(int(np.argmin(left / _MISFIT**2 + prior)), left.shape)
                parts[k], whole = every[k][b, a], others + every[k][b, a]
                x[3 + k], x[3 + self.count + k] = shifts[a], _DAMPINGS[b]
        x[2] = np.log(self._gain(rest + np.sum(parts, axis=0)))
        return x

    def refined(self, x: FloatArray) -> FloatArray:
        return np.asarray(
            scipy.optimize.least_squares(self._rows, x, self._slope, method="lm", max_nfev=60).x
        )

    def cost(self, x: FloatArray) -> float:
        return float((self._rows(x) ** 2).sum())

    def overlay(self, x: FloatArray, close: FloatArray, reach: FloatArray) -> Overlay:
        a, b = self._of_poles(x)
        gain, moved = float(np.exp(x[2])), self._model(x)
        peaks = np.abs(self.model.residues) / -self.model.poles.real
        hz = np.abs(self.model.poles) / (2 * np.pi)
        shown = (self.model.poles.imag > 0) & (hz >= self.f[0]) & (hz <= self.f[-1])
        peaks = np.where(shown, peaks, 0.0)
        factor, dampings = float(np.exp(close[2])), np.exp(self._of_poles(close)[1])
        weight = peaks / max(float(peaks.max()), 1e-300)
        left, residual = self._residual(close), self._residual(x)
        unsure = left * reach
        return Overlay(moved, np.expm1(a), np.exp(b), gain, factor, dampings, left, unsure, weight, residual)

    def reach(self, x: FloatArray) -> FloatArray:
        """Most that a residual of unit size changes each pole's damping: the one that looks most like it.

        A weak mode is little of the response, and poles that lie close stand in for each other.
        """
        rows = self._slope(x)
        lines = rows[: 2 * len(self.f)]
        back = np.linalg.inv(rows.T @ rows)
        # A group's damping is the common one and its own.
        own = back[3 + self.count :] + back[1]
        reach = np.einsum("ij,jk,ik->i", own, lines.T @ lines, own) ** 0.5 / self.misfit
        return np.asarray(reach[self.groups])

    def _model(self, x: FloatArray) -> Model:
        model, gain = self._moved(*self._of_poles(x)), float(np.exp(x[2]))
        return replace(
            model, residues=gain * model.residues, constant=gain * model.constant, slope=gain * model.slope
        )

    def _residual(self, x: FloatArray) -> float:
        return float(np.linalg.norm(self.measured - self._model(x).velocity(self.f) / self.size))

    def _of_poles(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Logarithms of each pole's frequency and damping, (poles,)."""
        return x[0] + x[3 + self.groups], x[1] + x[3 + self.count + self.groups]

    def _moved(self, a: FloatArray, b: FloatArray) -> Model:
        p = self.model.poles
        return replace(self.model, poles=np.exp(a) * (np.exp(b) * p.real + 1j * p.imag))

    def _rest(self) -> ComplexArray:
        s = 2j * np.pi * self.f
        return np.asarray((self.model.constant + self.model.slope * s) / self.size)

    def _part(self, poles: IntArray, shift: FloatArray, damping: float) -> NDArray[np.complex64]:
        """(shifts, lines): what these poles contribute when they are moved.

        In real numbers of single precision, because complex divisions took most of the time of a comparison.
        """
        w = (2 * np.pi * self.f).astype(np.float32)
        turned, slowed = np.exp(shift), np.exp(damping)
        part = np.zeros((len(shift), len(w)), dtype=np.complex64)
        for p, r in zip(self.model.poles[poles], self.model.residues[poles] / self.size, strict=True):
            moved = turned * (slowed * p.real + 1j * p.imag)
            # A real pole is half of a pair that coincides.
            share = 2 if p.imag > 0 else 1
            constant, radius, loss = (
                values.astype(np.float32)[:, None]
                for values in (-share * (r * np.conj(moved)).real, np.abs(moved), -2 * moved.real)
            )
            steep = (share * r.real * w).astype(np.float32)
            # (constant + j steep) / (s^2 + loss s + radius^2)
            across, below = loss * w, (radius - w) * (radius + w)
            size = 1 / (below**2 + across**2)
            part.real += (constant * below + steep * across) * size
            part.imag += (steep * below - constant * across) * size
        return part

    def _gain(self, shape: ComplexArray) -> float:
        return max(float(np.vdot(shape, self.measured).real / np.vdot(shape, shape).real), 1e-3)

    def _rows(self, x: FloatArray) -> FloatArray:
        a, b = self._of_poles(x)
        left = (self.measured - np.exp(x[2]) * self._moved(a, b).velocity(self.f) / self.size) / self.misfit
        return np.concatenate([left.real, left.imag, self._prior(x)])

    def _prior(self, x: FloatArray) -> FloatArray:
        own = x[3:].reshape(2, -1)
        return np.concatenate([own[0] / _SPREAD, own[1] / _DAMPING_SPREAD])

    def _slope(self, x: FloatArray) -> FloatArray:
        """Jacobian of `_rows`."""
        a, b = self._of_poles(x)
        model, n = self._moved(a, b), self.count
        gain = np.exp(x[2]) / self.size
        by_shift, by_damping = pole_slopes(model, self.f)
        member = gain * (self.groups[:, None] == np.arange(n))
        shift, damping = by_shift @ member, by_damping @ member
        level = gain * model.velocity(self.f)
        columns = np.column_stack([shift.sum(axis=1), damping.sum(axis=1), level, shift, damping])
        rows = -np.concatenate([columns.real, columns.imag]) / self.misfit
        prior = np.zeros((2 * n, 3 + 2 * n))
        prior[:, 3:] = np.diag(np.repeat([1 / _SPREAD, 1 / _DAMPING_SPREAD], n))
        return np.concatenate([rows, prior])


def _grid(reach: float) -> FloatArray:
    """Shifts to `reach` on either side, with exactly 0 in the middle, so that no start is made twice."""
    steps = round(reach / _GRID)
    return np.asarray(_GRID * np.arange(-steps, steps + 1), dtype=np.float64)


def _groups(model: Model) -> IntArray:
    """(poles,): numbers of the groups of poles that no response tells apart."""
    p = model.poles
    groups = np.arange(len(p))
    reach = _TOGETHER * np.maximum(-p.real[:, None], -p.real)
    for one, other in np.argwhere(np.abs(p[:, None] - p) < reach):
        groups[groups == groups[other]] = groups[one]
    return np.unique(groups, return_inverse=True)[1].reshape(-1)


_LEAST = 0.01
"""Rise of a mode's damping ratio (logarithm), beyond what the fit leaves open and beyond the least of the
modes, from which it is one: 1 % of a resonance's height."""
_CLEAR = 7.0
"""Least rise over the fit's residual: where modes drift by 1 to 3 % each the fit may not find all of them,
and what it leaves is no noise: then a mode seemed to rise by up to 5.2 of it."""
_FALL, _NOISE = 0.3, 0.01
"""Largest fall of another mode's, over the rise, and beside it, with which it may still be a body: under
hands none fell by more than 0.008."""
_UNLIKE = 0.5
"""Least difference between modes, over the largest rise: under hands it was 0.63 and more. A change of all
dampings alike has none, and a drift of all frequencies, which seems to damp by 0.8 of itself, up to 0.42."""
_EDGE = 0.02
"""Distance from the band's upper edge, over it, within which a mode is not looked at: half of its resonance
was not measured, and a drift takes it out of the band or brings another in."""
_SEEN = 0.05
"""Peak of a resonance, over the strongest of the band, from which its damping is known well enough."""
TAKE_AWAY = (
    "Take hands and things off the table, and run it again. If nothing is on it, run it with somebody there "
    "who confirms that (--attended): the dampings then count as a drift."
)


@dataclass(frozen=True)
class Dampings:
    """How the dampings of the modes of a place changed."""

    changes: tuple[float, ...] = (0.0,)
    """Logarithm of each mode's factor."""
    unsure: tuple[float, ...] = (0.0,)
    """How far the fit leaves each of them open."""
    left: float = 0.0
    """Residual of that fit."""

    @property
    def risen(self) -> float:
        """Change of the mode that rose most, beyond what the fit leaves open."""
        return max(zip(self.changes, self.unsure, strict=True), key=lambda mode: mode[0] - mode[1])[0]

    @property
    def lowest(self) -> float:
        """Least change."""
        return min(self.changes)

    @property
    def touched(self) -> bool:
        """True when a body that rests on the table explains them, and one factor does not."""
        rise, lowest = self.risen, self.lowest
        sure = max(change - unsure for change, unsure in zip(self.changes, self.unsure, strict=True))
        clear = sure - max(lowest, 0.0) > _LEAST and rise > _CLEAR * self.left
        return clear and rise - lowest > _UNLIKE * rise and -lowest < _FALL * rise + _NOISE

    @property
    def inverse(self) -> Dampings:
        """The change back."""
        return replace(self, changes=tuple(-change for change in self.changes))


def dampings_of(model: Model, laid: Overlay) -> Dampings:
    """Changes of damping of a model's modes, by what was laid over them."""
    weight = laid.weight
    hz = np.abs(model.poles) / (2 * np.pi)
    highest = np.maximum(hz, hz * (1 + laid.shift))
    inside = (hz > BAND[0]) & (highest < (1 - _EDGE) * BAND[1]) & (model.poles.imag > 0)
    if not inside.any():
        return Dampings()
    known = inside & (weight > _SEEN * weight[inside].max())
    changes, unsure = np.log(laid.dampings[known]), laid.unsure[known]
    return Dampings(tuple(changes.tolist()), tuple(unsure.tolist()), laid.left)


def told_touched(verdicts: Sequence[Verdict]) -> tuple[str, ...]:
    """A sentence for each place at which something seems to rest on the table."""
    return tuple(
        f"Something seems to rest on the table: seen by patch {one.patch} at the {one.point} point, the "
        f"dampings of its modes changed by {np.expm1(one.dampings.lowest):+z.0%} to "
        f"{np.expm1(one.dampings.risen):+z.0%}, as a finger or a palm changes them, and a drift hardly."
        for one in verdicts
        if one.dampings.touched
    )
