"""One curve that stands for many: a dynamic time warping barycentre, refined by registration.

The barycentre (Petitjean et al., Pattern Recognition 44(3), 2011) finds which sample of one press
belongs to which of another, however they are stretched; but it puts the template at the wrong time
(its mean warp is not zero) and copies noise into steps. So its paths only start a registration:
every curve gets a smooth warp t + d(t), with d a cubic spline on a few knots, that is as stiff as the
noise allows, and all warps together have mean zero. The model is that presses differ by a smooth
change of tempo; events that jitter independently are followed as far as the stiffness lets them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dtaidistance import dtw, dtw_barycenter
from scipy.interpolate import BSpline, CubicSpline

from instruments.arrays import FloatArray, IntArray

__all__ = ["Registration", "WarpModel", "register"]


@dataclass(frozen=True)
class WarpModel:
    """What a warp may be."""

    knots: int = 24
    """Over the window."""
    stretch: float = 0.06
    """Standard deviation of the tempo's change (relative) that is expected from press to press."""
    reach: float = 0.03
    """s: the farthest that a sample is looked for in another curve."""
    rounds: int = 12
    """Of warps and template in turn; the first ones are stiffer."""
    rescues: int = 2
    """How often curves that stayed behind start again from their path to the template."""
    floor: float = 0.02
    """Smallest residual, relative to the curves, that is taken for noise: nothing is fitted better."""
    outlier: float = 2.5
    """A curve whose residual is this many times the median one counts less, by the square of the excess."""


@dataclass(frozen=True, eq=False)
class Registration:
    """Curves brought to one time. `template` is (channels, samples)."""

    template: FloatArray
    aligned: FloatArray
    """(curves, channels, samples)."""
    shifts: FloatArray
    """(curves, samples), in samples: aligned[i](t) = curve[i](t + shifts[i](t)). Their mean is zero."""
    weights: FloatArray
    """(curves,), 1 for a curve that is no outlier."""


def register(curves: FloatArray, rate_hz: float, model: WarpModel | None = None) -> Registration:
    """Bring (curves, channels, samples) to one time by the first channel, and average them all.

    The curves should already be aligned to within `reach`, at an event that each of them has.
    """
    m = model or WarpModel()
    count, _, samples = curves.shape
    if count == 1:
        return Registration(curves[0], curves, np.zeros((1, samples)), np.ones(1))
    work = _Work(np.ascontiguousarray(curves[:, 0]), rate_hz, m)
    # From the barycentre's paths, and from no warp at all: where the curves agree already, paths
    # through noise are the worse start.
    starts = (np.zeros((count, m.knots)), work.from_paths(work.barycentre()))
    coefficients = min((work.refine(start, m.rounds) for start in starts), key=work.cost)
    for _ in range(m.rescues):
        coefficients = work.refine(work.rescue(coefficients), m.rounds // 3)
    shifts = coefficients @ work.basis.T
    splines = [CubicSpline(np.arange(samples), curve, axis=-1) for curve in curves]
    aligned = np.stack([_at(s, shift) for s, shift in zip(splines, shifts, strict=True)])
    weights = _weights(aligned[:, 0], m)
    return Registration(np.average(aligned, axis=0, weights=weights), aligned, shifts, weights)


class _Work:
    """Curves (curves, samples) and all that is computed of them once. Warps are (curves, knots)."""

    def __init__(self, lead: FloatArray, rate_hz: float, m: WarpModel) -> None:
        samples = lead.shape[1]
        self.lead = lead
        self.m = m
        self.window = max(2, round(m.reach * rate_hz))
        self.basis = _basis(samples, m.knots)
        self.prior = _prior(self.basis, samples, self.window / 3, m)
        self.splines = [CubicSpline(np.arange(samples), curve) for curve in lead]
        self.slopes = [spline.derivative() for spline in self.splines]
        self.floor = m.floor**2 * float(np.mean(lead**2))

    def template(self, warps: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """What the warped curves have in common, their weights, and the noise (power) around it."""
        aligned = np.stack([_at(s, self.basis @ c) for s, c in zip(self.splines, warps, strict=True)])
        weights = _weights(aligned, self.m)
        template = np.average(aligned, axis=0, weights=weights)
        power = np.mean((aligned - template) ** 2, axis=1)
        return template, weights, max(float(np.average(power, weights=weights)), self.floor)

    def cost(self, warps: FloatArray) -> float:
        """What is left between the curves, outliers at their full weight, and a little for the warps."""
        template, _, _ = self.template(warps)
        bent = np.einsum("ik,kl,il->i", warps, self.prior, warps)
        return sum(
            float(np.sum((_at(s, self.basis @ c) - template) ** 2)) + self.floor * float(stiff)
            for s, c, stiff in zip(self.splines, warps, bent, strict=True)
        )

    def refine(self, warps: FloatArray, rounds: int) -> FloatArray:
        """Template and warps in turn. The noise falls as the curves come together, and with it the
        stiffness.
        """
        for _ in range(rounds):
            template, weights, noise = self.template(warps)
            moved = np.stack([self.step(i, c, template, noise) for i, c in enumerate(warps)])
            # An outlier's warp says nothing about where the others' middle is.
            moved -= np.average(moved, axis=0, weights=weights)
            settled = np.abs(moved - warps).max() < 0.02  # of a sample
            warps = moved
            if settled:
                break
        return warps

    def rescue(self, warps: FloatArray) -> FloatArray:
        """Curves that are farther from the template than most start again from their path to it.

        A click is a short oscillation: a warp that is a period off is a trap for small steps.
        """
        template, _, noise = self.template(warps)
        left = [self.distance(i, c, template, noise) for i, c in enumerate(warps)]
        far = np.flatnonzero(np.asarray(left) > 1.5 * np.median(left))
        warps = warps.copy()
        for i, start in zip(far.tolist(), self.from_paths(template, far), strict=True):
            warp = start
            for _ in range(self.m.rounds):
                warp = self.step(i, warp, template, noise)
            if self.distance(i, warp, template, noise) < left[i]:
                warps[i] = warp
        return warps

    def distance(self, i: int, warp: FloatArray, template: FloatArray, noise: float) -> float:
        """What a warp costs: squares that are left, and bending as dear as the noise makes it."""
        shift = self.basis @ warp
        if np.min(np.diff(shift)) < -0.7:  # time must not run backwards
            return np.inf
        rest = _at(self.splines[i], shift) - template
        return float(rest @ rest + noise * (warp @ self.prior @ warp))

    def step(self, i: int, warp: FloatArray, template: FloatArray, noise: float) -> FloatArray:
        """One Gauss-Newton step of curve `i` towards the template, as far as that lowers its cost."""
        shift = self.basis @ warp
        jacobian = _at(self.slopes[i], shift)[:, None] * self.basis
        rest = _at(self.splines[i], shift) - template
        stiff = noise * self.prior
        step = np.linalg.solve(jacobian.T @ jacobian + stiff, jacobian.T @ rest + stiff @ warp)
        before = self.distance(i, warp, template, noise)
        for fraction in (1.0, 0.5, 0.25, 0.1):
            moved = np.asarray(warp - fraction * step)
            if self.distance(i, moved, template, noise) < before:
                return moved
        return warp

    def barycentre(self) -> FloatArray:
        """The curves' DTW barycentre, begun at the curve nearest to their mean."""
        near = int(np.argmin(np.sum((self.lead - self.lead.mean(axis=0)) ** 2, axis=1)))
        options = {"window": self.window, "use_c": True}
        return np.asarray(
            dtw_barycenter.dba_loop(list(self.lead), c=self.lead[near].copy(), max_it=2, thr=1e-4, **options)
        )

    def from_paths(self, template: FloatArray, which: IntArray | None = None) -> FloatArray:
        """Warps that follow the curves' DTW paths to a template (all curves, or these)."""
        noise = max(self.floor, 1e-30)
        slope = np.gradient(template) ** 2 / noise
        warps = []
        for curve in self.lead if which is None else self.lead[which]:
            path = np.asarray(dtw.warping_path(template, curve, window=self.window, use_c=True))
            at, lag = path[:, 0], (path[:, 1] - path[:, 0]).astype(np.float64)
            # A path through silence is chance; where the template is steep it knows what it says.
            weighted = self.basis[at] * slope[at][:, None]
            warps.append(np.linalg.solve(self.basis[at].T @ weighted + self.prior, weighted.T @ lag))
        return np.array(warps).reshape(-1, self.m.knots)


def _basis(samples: int, knots: int) -> FloatArray:
    """(samples, knots) cubic B-splines over the window."""
    inner = np.linspace(0, samples - 1, knots - 2)
    padded = np.concatenate([[0.0] * 3, inner, [samples - 1.0] * 3])
    return np.asarray(BSpline.design_matrix(np.arange(samples, dtype=float), padded, 3).toarray())


def _prior(basis: FloatArray, samples: int, offset: float, m: WarpModel) -> FloatArray:
    """(knots, knots): the penalty of a warp whose tempo changes by `stretch` is about one a knot, and of
    one that is `offset` samples off as a whole is one.
    """
    tempo = np.diff(basis, axis=0)
    level = basis.mean(axis=0)
    per_sample = m.knots / samples / m.stretch**2
    return np.asarray(tempo.T @ tempo * per_sample + np.outer(level, level) / offset**2)


def _at(spline: CubicSpline, shift: FloatArray) -> FloatArray:
    """A curve along its warp; beyond its ends it stays as it ends."""
    n = len(shift)
    return np.asarray(spline(np.clip(np.arange(n) + shift, 0, n - 1)))


def _weights(aligned: FloatArray, m: WarpModel) -> FloatArray:
    """(curves,): 1, and less for a curve that is far from the median curve compared with the others."""
    if len(aligned) < 4:
        return np.ones(len(aligned))
    residual = np.sqrt(np.mean((aligned - np.median(aligned, axis=0)) ** 2, axis=1))
    limit = m.outlier * float(np.median(residual))
    return np.asarray(np.minimum(1.0, (limit / np.maximum(residual, 1e-30)) ** 2))
