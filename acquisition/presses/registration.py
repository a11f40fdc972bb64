"""Register curves to a common time by smooth warps.

Every curve gets a warp t + d(t), with d a cubic spline on a few knots. The noise sets the stiffness of
the warps, and their mean, weighted as the curves are, is zero. The model assumes that presses differ by a
smooth change of tempo; events that jitter independently are aligned only as far as the stiffness allows.

Of many curves, some at a time are in memory: of each a spline of four coefficients a sample, and what is
computed with it. Of all there are the curve itself, its DTW path, and an eighth of a curve for their median.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise

import numpy as np
import scipy

from ...base.arrays import BoolArray, FloatArray, IntArray
from ...base.errors import ConfigurationError
from .barycentre import WarpingPath, coarse_paths
from .spline_rows import SplineRows, moved, splines
from .spool import Spool

_COARSE = 4
"""Every so many samples are compared with their median, which is slow to find."""
_BLOCK = 96
"""Curves of a block; the last has up to twice as many. The last digits of a product of matrices depend on its
size when that is small, and not a multiple of what a processor computes at once: 4 to 24 rows."""
_SILENT = 10.0
"""Squared slope, over the median of a template, up to which it is silence: a path is random there."""
_EXACT = 0.05
"""Standard deviation of a path's lag within an event, in samples."""
_STIFFER = 10.0 ** np.arange(6)
"""Stiffnesses to try, over the prior's, until a warp that follows a path does not reverse time."""
_UNLIKE = 0.25
"""Residual, over the median curve, up to which no curve is an outlier: curves that agree to a percent have
some that agree to three."""


@dataclass(frozen=True)
class WarpModel:
    """Parameters of the warps."""

    knots: int = 24
    """Number of spline knots over the window."""
    stretch: float = 0.06
    """Expected standard deviation of the relative tempo between presses."""
    reach: float = 0.03
    """s: largest lag between matching samples of two curves."""
    rounds: int = 12
    """Alternating updates of template and warps; the first ones are stiffer."""
    rescues: int = 2
    """Number of restarts of badly aligned curves from their DTW path to the template."""
    floor: float = 0.02
    """Smallest noise estimate, relative to the curves; fits never go below it."""
    outlier: float = 2.5
    """Residual, in multiples of the median, above which a curve's weight falls with the inverse square: how
    loud a curve is does not count, nor does what is below a quarter of a curve."""

    def __post_init__(self) -> None:
        """Raises ConfigurationError."""
        positive = (self.stretch, self.reach, self.rounds, self.floor, self.outlier)
        if not (self.knots >= 4 and min(positive) > 0 and self.rescues >= 0 and np.isfinite(sum(positive))):
            raise ConfigurationError(
                f"{self} is no model of warps: use four knots or more, and numbers above zero."
            )

    def window(self, rate_hz: float) -> int:
        """`reach` in samples."""
        return max(2, round(self.reach * rate_hz))

    def every(self, rate_hz: float) -> int:
        """Samples between the places at which curves are compared: a click has no content above 1 kHz."""
        return max(1, int(rate_hz // 2500))


@dataclass(frozen=True, eq=False)
class Registration:
    """Registered curves, in blocks of some curves; those of many curves are read when they are asked for."""

    template: FloatArray
    """(channels, samples)."""
    aligned: Sequence[FloatArray]
    """Each (curves, samples): their first channel."""
    shifts: Sequence[FloatArray]
    """Each (curves, samples), in samples: aligned[i](t) = curve[i](t + shifts[i](t)). Their weighted mean is
    zero, nearly: the weights are those before the last step."""


def register(
    curves: Sequence[FloatArray] | FloatArray,
    rate_hz: float,
    model: WarpModel | None = None,
    start: tuple[FloatArray, Sequence[WarpingPath]] | None = None,
) -> Registration:
    """Register curves, each (channels, samples), by the first channel, and average all channels.

    The curves must already be aligned within `reach` at an event common to all. `start` is a first template
    (samples,) with the curves' DTW paths to it, such as `barycentre` returns. The fit then runs twice, once
    from these paths and once from zero warps, and the result with the lower cost is kept.
    """
    m = model or WarpModel()
    count, (channels, samples) = len(curves), curves[0].shape
    if count == 1:
        return Registration(curves[0], [curves[0][:1]], [np.zeros((1, samples))])
    work = _Work(leads(curves), rate_hz, m)
    # Zero warps are the better start when the curves already agree: DTW paths then follow noise.
    starts = [np.zeros((count, m.knots))]
    if start is not None:
        starts.append(work.from_paths(*start, count))
    warps = min((work.refine(begin, m.rounds) for begin in starts), key=work.cost)
    for _ in range(m.rescues):
        warps = work.refine(work.rescue(warps), m.rounds // 3)
    basis = _basis(np.arange(samples), samples, m.knots)
    parts, lead = _blocks(count), work.lead
    del work
    shifts = _kept((warps[some] @ basis.T for some in parts), len(parts))
    aligned = _kept((moved(lead[some], by) for some, by in zip(parts, shifts, strict=True)), len(parts))
    weights = _weights(np.concatenate([rows[:, ::_COARSE] for rows in aligned]), m)
    template = [_average(aligned, weights)]
    for channel in range(1, channels):
        rows = (np.stack([curve[channel] for curve in curves[some]]) for some in parts)
        template.append(_average((moved(own, by) for own, by in zip(rows, shifts, strict=True)), weights))
    return Registration(np.stack(template), aligned, shifts)


def leads(curves: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """The first channels (curves, samples) of curves, each (channels, samples), read one by one."""
    rows = np.empty((len(curves), curves[0].shape[1]))
    for row, curve in zip(rows, curves, strict=True):
        row[:] = curve[0]
    return rows


def _blocks(count: int) -> list[slice]:
    """Slices of so many curves."""
    bounds = [*range(0, max(1, count - _BLOCK + 1), _BLOCK), count]
    return [slice(first, end) for first, end in pairwise(bounds)]


def _kept(blocks: Iterable[FloatArray], number: int) -> Sequence[FloatArray]:
    """Keep so many blocks: one in memory, more on the disk."""
    if number == 1:
        return list(blocks)
    spool = Spool()
    for block in blocks:
        spool.append(block)
    return spool


def _average(blocks: Iterable[FloatArray], weights: FloatArray) -> FloatArray:
    """Weighted mean (samples,) of blocks (curves, samples): the bits of `np.average` of all curves."""
    _, whole = np.average(np.zeros((len(weights), 1)), axis=0, weights=weights, returned=True)
    total, done = None, 0
    for rows in blocks:
        share = rows * weights[done : done + len(rows), None]
        done += len(rows)
        if total is not None:
            share[0] += total
        total = share.sum(axis=0)
    assert total is not None
    return np.asarray(total / whole)


class _Work:
    """Curves (curves, samples) with the values computed once for all steps. Warps are (curves, knots).

    Curves are compared at `places` only, see `WarpModel.every`.
    """

    def __init__(self, lead: FloatArray, rate_hz: float, m: WarpModel) -> None:
        samples = lead.shape[1]
        self._every = m.every(rate_hz)
        self.lead = lead
        self.m = m
        self.window = m.window(rate_hz)
        self._parts = _blocks(len(lead))
        made = (splines(lead[some]) for some in self._parts)
        # One block stays; of several, any curve's spline can be asked for.
        self._splines = next(made) if len(self._parts) == 1 else _each(made)
        self.places = np.arange(0, samples, self._every)
        self.basis = _basis(self.places, samples, m.knots)
        # Only neighbouring B-splines overlap: all other products are zero.
        self.pairs = np.array([(a, b) for a in range(m.knots) for b in range(a, min(a + 4, m.knots))]).T
        self.products = self.basis[:, self.pairs[0]] * self.basis[:, self.pairs[1]]
        self.prior = _prior(samples, self.window / 3, m) / self._every
        self.floor = max(m.floor**2 * float(np.mean(lead**2)), 1e-30)  # silent presses have none

    def rows(self, which: IntArray) -> tuple[SplineRows, IntArray]:
        """The splines of these curves, of a block at most, and their numbers there."""
        if isinstance(self._splines, Spool):
            pieces = np.stack([self._splines[int(one)] for one in which])
            return SplineRows(pieces, self._every), np.arange(len(which))
        return SplineRows(self._splines, self._every), which

    def aligned(self, warps: FloatArray) -> Iterator[FloatArray]:
        """The warped curves (curves, places), in blocks."""
        for some in self._parts:
            rows, which = self.rows(np.arange(some.start, some.stop))
            yield rows.at(warps[some] @ self.basis.T, which)

    def template(self, warps: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Weighted mean of the warped curves, their weights, and the noise power around the mean."""
        aligned = _kept(self.aligned(warps), len(self._parts))
        weights = _weights(np.concatenate([rows[:, ::_COARSE] for rows in aligned]), self.m)
        template = _average(aligned, weights)
        power = np.concatenate([np.mean((rows - template) ** 2, axis=1) for rows in aligned])
        return template, weights, max(float(np.average(power, weights=weights)), self.floor)

    def cost(self, warps: FloatArray) -> float:
        """Residual sum of squares, outliers at full weight, plus a small penalty on the warps."""
        template, _, _ = self.template(warps)
        left = sum(float(np.sum((rows - template) ** 2)) for rows in self.aligned(warps))
        return float(left + self.floor * np.einsum("ik,kl,il->", warps, self.prior, warps))

    def refine(self, warps: FloatArray, rounds: int) -> FloatArray:
        """Update template and warps in turn. The stiffness falls with the noise as the curves converge."""
        for _ in range(rounds):
            template, weights, noise = self.template(warps)
            moved = self.step(warps, template, noise, np.arange(len(warps)))
            # Weighted mean: an outlier's warp must not shift the other curves.
            moved -= np.average(moved, axis=0, weights=weights)
            settled = np.abs(moved - warps).max() < 0.02  # of a sample
            warps = moved
            if settled:
                break
        return warps

    def rescue(self, warps: FloatArray) -> FloatArray:
        """Restart the curves farthest from the template from their DTW path to it.

        A click is a short oscillation, so a warp that is off by one period is a local minimum.
        """
        template, _, noise = self.template(warps)
        left = self.distances(warps, template, noise)
        far = np.flatnonzero(left > 1.5 * np.median(left))
        if not len(far):
            return warps
        tried = warps.copy()
        whole = scipy.interpolate.CubicSpline(self.places, template)(np.arange(self.lead.shape[1]))
        tried[far] = self.from_paths(
            whole, coarse_paths(whole, self.lead[far], self.window, self._every), len(far)
        )
        for _ in range(self.m.rounds):
            tried = self.step(tried, template, noise, far)
        better = self.distances(tried, template, noise) < left
        return np.where(better[:, None], tried, warps)

    def distances(self, warps: FloatArray, template: FloatArray, noise: float) -> FloatArray:
        """Cost of the warp of each curve, see `_priced`."""
        found = []
        for some in self._parts:
            rows, which = self.rows(np.arange(some.start, some.stop))
            found.append(self._distance(rows, which, warps[some], template, noise))
        return np.concatenate(found)

    def _distance(
        self, rows: SplineRows, which: IntArray, warps: FloatArray, template: FloatArray, noise: float
    ) -> FloatArray:
        shifts = warps @ self.basis.T
        return self._priced(rows.at(shifts, which) - template, warps, shifts, noise)

    def _priced(self, rest: FloatArray, warps: FloatArray, shifts: FloatArray, noise: float) -> FloatArray:
        """Residual sum of squares plus noise-weighted bending; infinite for a reversal of time."""
        bent = np.einsum("ik,ik->i", warps @ self.prior, warps)
        price = np.einsum("is,is->i", rest, rest) + noise * bent
        return np.asarray(np.where(self._backwards(shifts), np.inf, price))

    def step(self, warps: FloatArray, template: FloatArray, noise: float, which: IntArray) -> FloatArray:
        """Take one Gauss-Newton step with each of these curves, shortened until it lowers the cost."""
        warps = warps.copy()
        for some in _blocks(len(which)):
            part = which[some]
            warps[part] = self._stepped(*self.rows(part), warps[part], template, noise)
        return warps

    def _stepped(
        self, rows: SplineRows, which: IntArray, here: FloatArray, template: FloatArray, noise: float
    ) -> FloatArray:
        shifts = here @ self.basis.T
        values, slopes = rows.with_slopes(shifts, which)
        rest = values - template
        stiff = noise * self.prior
        downhill = (slopes * rest) @ self.basis + here @ stiff
        step = np.linalg.solve(self.normal(slopes**2) + stiff, downhill[..., None])[..., 0]
        before = self._priced(rest, here, shifts, noise)
        warps, left = here.copy(), np.arange(len(which))
        for fraction in (1.0, 0.5, 0.25, 0.1):
            moved = here[left] - fraction * step[left]
            better = self._distance(rows, which[left], moved, template, noise) < before[left]
            warps[left[better]] = moved[better]
            left = left[~better]
            if not len(left):
                break
        return warps

    def normal(self, weights: FloatArray) -> FloatArray:
        """Normal matrices (rows, knots, knots): products of the splines, weighted by (rows, places)."""
        a, b = self.pairs
        whole = np.zeros((len(weights), self.m.knots, self.m.knots))
        whole[:, a, b] = whole[:, b, a] = weights @ self.products
        return whole

    def from_paths(self, template: FloatArray, paths: Iterable[WarpingPath], count: int) -> FloatArray:
        """Warps that follow the DTW paths of so many curves to a template (samples,)."""
        following = iter(paths)
        some = (list(islice(following, one.stop - one.start)) for one in _blocks(count))
        return np.concatenate([self._followed(template, part) for part in some])

    def _followed(self, template: FloatArray, paths: Sequence[WarpingPath]) -> FloatArray:
        slope = np.gradient(template) ** 2 / self.floor
        # The steeper the template, the better a lag is known, down to what a path can tell.
        event = np.maximum(slope - _SILENT * np.median(slope), 0.0)
        trust = event / (1 + event * _EXACT**2)
        weights, lags = np.zeros((2, len(paths), len(self.places)))
        for row, (at, there) in enumerate(paths):
            weights[row] = (trust * np.bincount(at, minlength=len(trust)))[self.places]
            lags[row] = (trust * np.bincount(at, there - at, len(trust)))[self.places]
        normal, aims = self.normal(weights), (lags @ self.basis)[..., None]
        warps, left = np.zeros((len(paths), self.m.knots)), np.arange(len(paths))
        for stiffness in _STIFFER:
            warps[left] = np.linalg.solve(normal[left] + stiffness * self.prior, aims[left])[..., 0]
            left = left[self._backwards(warps[left] @ self.basis.T)]
            if not len(left):
                break
        return warps

    def _backwards(self, shifts: FloatArray) -> BoolArray:
        """Whether a warp (rows, places) comes near to a reversal of time (rows,)."""
        return np.asarray(np.diff(shifts, axis=1).min(axis=1) < -0.7 * self.places[1])


def _each(blocks: Iterable[FloatArray]) -> Spool:
    """Keep the rows of blocks on the disk, each by itself."""
    spool = Spool()
    for block in blocks:
        for row in block:
            spool.append(row)
    return spool


def _basis(places: IntArray, samples: int, knots: int) -> FloatArray:
    """Cubic B-splines (places, knots) over the window."""
    inner = np.linspace(0, samples - 1, knots - 2)
    padded = np.concatenate([[0.0] * 3, inner, [samples - 1.0] * 3])
    return np.asarray(scipy.interpolate.BSpline.design_matrix(places.astype(np.float64), padded, 3).toarray())


def _prior(samples: int, offset: float, m: WarpModel) -> FloatArray:
    """Penalty matrix (knots, knots) of a warp.

    The penalty is about one per knot for a relative tempo of `stretch`, and one for a mean shift of
    `offset` samples.
    """
    basis = _basis(np.arange(samples), samples, m.knots)
    tempo = np.diff(basis, axis=0)
    level = basis.mean(axis=0)
    per_sample = m.knots / samples / m.stretch**2
    return np.asarray(tempo.T @ tempo * per_sample + np.outer(level, level) / offset**2)


def _weights(coarse: FloatArray, m: WarpModel) -> FloatArray:
    """Weights (curves,): 1, or less for a curve unusually far from the median curve, however loud.

    `coarse` is (curves, samples) of every _COARSE-th sample.
    """
    if len(coarse) < 4:
        return np.ones(len(coarse))
    median = np.median(coarse, axis=0)
    # A finger presses hard or softly. Were loud presses to count less, the mean of the times would be that
    # of the others.
    loudness = np.maximum(coarse @ median, 0.0) / max(float(median @ median), 1e-300)
    residual = np.sqrt(np.mean((coarse - loudness[:, None] * median) ** 2, axis=1))
    limit = max(m.outlier * float(np.median(residual)), _UNLIKE * float(np.sqrt(np.mean(median**2))))
    # Curves without any difference, or any content, count alike.
    return np.asarray(np.where(residual > limit, (limit / np.maximum(residual, 1e-30)) ** 2, 1.0))
