"""The poles of a response: least-squares fit of a rational function, with an order selected from the data.

Which of its pole pairs are resonances is told by the uncertainty of their decay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.filters import half_width, peaks
from ..response import Response
from .projection import Lines, Projection

_MOST_POLES = 100
_STEPS, _LAST = 6, 30
"""Largest number of refinement steps during the search for the order, and of the last refinement."""
_SETTLED, _CONVERGED = 5e-3, 1e-4
"""Relative gain of a step below which refinement ends: during the search, and at the end."""
_PENALTY = 4.0
"""Cost of a real parameter in twice the log-likelihood: between Akaike's 2 and the logarithm of the number
of lines, because a pole with a free frequency fits more noise than a linear parameter."""
_DAMPINGS = (0.015, 0.05)
"""Damping ratios of the candidate pole pairs for the residual of a fit, besides narrow ones at its peaks."""
_BELOW, _ABOVE = np.array([0.5, 0.8]), np.array([1.03, 1.1, 1.3, 1.8])
"""Further candidates, over the band's ends: modes outside the band bend the response within it."""
_LIKELY, _NARROW = 16, 8
"""Number of candidates, and of narrow ones at the largest residuals, that are looked at closely."""
_AT_ONCE = 4
"""Pole pairs that are added at a time, at most."""
_ROUNDS = 4
"""Rounds that may be worth their pairs together only, while the error is coarse."""
_NOISY = 1.5
"""Power of the residual, over the known noise, up to which it counts as noise."""
_GOOD = 0.0095
"""Relative error below which more than noise is described only by pairs that each take away a quarter."""
_LESS, _LESS_COARSE = 0.75, 0.92
"""Largest part of the residual's power that another pair may leave, below and above that error."""
_EXACT = 1e-5
"""Relative error below which no pair is added."""
_COINCIDENT = 0.1
"""Distance of two poles, over their decay, within which one response cannot distinguish them."""
_TRUST, _TRIES = 0.1, 3
"""Initial damping of the refinement's steps (Levenberg-Marquardt), and attempts at each."""
_AS_FORESEEN, _LESS_THAN_FORESEEN = 0.75, 0.25
"""Gain of a step over that of the linearised problem, above which damping falls, and below which it rises."""
_NARROWEST = 0.02
"""Smallest half-power width of a fitted pole pair, over the lines' spacing."""


def fit_poles(lines: Lines) -> ComplexArray:
    """Fit the poles (rad/s), one of each conjugate pair.

    The first pairs are the peaks. Then those that explain most of the residual are added, as long as they
    gain more than their parameters cost. Every step is followed by a least-squares refinement of all poles.
    """
    lines = lines.averaged()
    with threadpool_limits(1):
        best, candidates = _refined(_peaks(lines), lines), _Candidates.of(lines)
        while len(best.poles) < _MOST_POLES and best.error > _EXACT:
            better = candidates.better(best)
            if better is None:
                break
            best = better
        best = _pruned(best)
        return _refined(best.poles, lines, _LAST, _CONVERGED if best.power < _NOISY else _SETTLED).poles


def _gain(fit: Projection, other: Projection) -> float:
    """Twice the gain in log-likelihood over another fit, less the cost of additional parameters.

    The number of independent rows is taken from the fit with the smaller residual, because the
    residual of the other is not noise alone.
    """
    independent = min((fit, other), key=lambda one: one.power).independent
    gained = 2 * independent * float(np.log(max(other.power, 1e-300) / max(fit.power, 1e-300)))
    return gained - _PENALTY * (fit.parameters - other.parameters)


def _worth(fit: Projection, other: Projection) -> bool:
    """True when it gains, and leaves only noise or clearly less: a smaller gain may be distortion."""
    pairs = max(len(fit.poles) - len(other.poles), 1)
    return _gain(fit, other) > 0 and fit.power < max(_NOISY, _most_left(other) ** pairs * other.power)


def _most_left(fit: Projection) -> float:
    """Largest part of the residual's power that another pair may leave."""
    return _LESS if fit.error < _GOOD else _LESS_COARSE


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Poles (candidates,) rad/s, and their partial fractions (candidates, rows) of unit norm."""

    poles: ComplexArray
    shapes: NDArray[np.complex64]
    lines: Lines

    @classmethod
    def of(cls, lines: Lines) -> _Candidates:
        low, high = np.log(lines.f[0]), np.log(lines.f[-1])
        places = [
            2 * np.pi * np.exp(np.arange(low, high, zeta)) * (1j * np.sqrt(1 - zeta**2) - zeta)
            for zeta in _DAMPINGS
        ]
        poles = np.concatenate(places)
        return cls(poles, _shapes(poles, lines), lines)

    def better(self, fit: Projection) -> Projection | None:
        """Fit with more pairs that is worth them, None without one.

        While whole modes are missing, none may be worth it by itself, but several together.
        """
        found = fit
        for _ in range(1 if fit.error < _GOOD or fit.power < _NOISY else _ROUNDS):
            missing = self.missing(found)
            if not len(missing):
                break
            poles = np.append(found.poles, missing)
            together = _refined(poles, self.lines)
            if _worth(together, fit):
                return together
            alone = _refined(poles[: len(found.poles) + 1], self.lines) if len(missing) > 1 else together
            if _worth(alone, fit):
                return alone
            found = together
        return None

    def missing(self, fit: Projection) -> ComplexArray:
        """Poles (rad/s) that explain most of a residual, the best one first, none near another one."""
        left, lines = fit.residual, self.lines
        spacing = lines.spacing * lines.block
        likely = self.poles[np.argsort(-np.abs(self.shapes @ left.astype(np.complex64)))[:_LIKELY]]
        around = np.convolve(np.abs(left) ** 2, np.ones(3), "same")
        narrow = 2 * np.pi * (1j * lines.centres[np.argsort(-around)[:_NARROW]] - 0.5 * spacing)
        places = np.concatenate([likely, narrow, _beyond(lines)])
        explained = fit.explained(places)
        # Refinement can make a pair explain several times as much, but not arbitrarily more.
        hopeless = (1 - _most_left(fit)) / 2.5 * fit.power * len(left)
        if fit.power < _NOISY:
            hopeless = 2 * _PENALTY * fit.power * len(left) / fit.independent
        least = max(hopeless, 0.5 * float(explained.max()))
        found: list[complex] = []
        for k in np.argsort(-explained):
            if len(found) == _AT_ONCE or explained[k] < least:
                break
            p = places[k]
            if all(abs(p - q) > 4 * max(-p.real, -q.real, np.pi * spacing) for q in found):
                found.append(p)
        return np.array(found)


def _beyond(lines: Lines) -> ComplexArray:
    """Candidates below and above the band (rad/s)."""
    places = 2 * np.pi * np.concatenate([_BELOW * lines.f[0], _ABOVE * lines.f[-1]])
    return np.asarray(places * (1j - _DAMPINGS[0]))


def _shapes(poles: ComplexArray, lines: Lines) -> NDArray[np.complex64]:
    """Conjugates of partial fractions (poles, rows) of unit norm, in single precision."""
    w = (2 * np.pi * lines.f).astype(np.float32)
    d, off = -poles.real.astype(np.float32)[:, None], w - poles.imag.astype(np.float32)[:, None]
    size = 1 / (d**2 + off**2)
    size /= np.sqrt(size.sum(axis=1))[:, None]
    shape = np.empty(size.shape, dtype=np.complex64)
    np.multiply(d, size, out=shape.real)
    np.multiply(off, size, out=shape.imag)
    if lines.block > 1:
        shape = shape.reshape(len(shape), -1, lines.block).sum(axis=2)
    return np.asarray(shape, dtype=np.complex64)


def _pruned(best: Projection) -> Projection:
    """Remove the poles that gain less than they cost, and those that nearly coincide with others.

    A fit can contain two pairs that nearly coincide and cancel, each far larger than their sum. Such a fit
    is a local minimum, and the pair whose removal increases the residual least is a different one, so
    coincident pairs are tried separately.
    """
    while len(best.poles) > 1:
        costs = best.costs()
        weakest = int(np.argmin(costs))
        hopeless = best.independent * np.log1p(costs[weakest] / max(best.power, 1e-300)) > 8 * _PENALTY
        tried = (
            _refined(np.delete(best.poles, k), best.lines)
            for k in [*([] if hopeless else [weakest]), *_doubles(best.poles)]
        )
        better = next((fit for fit in tried if _gain(fit, best) > 0), None)
        if better is None:
            break
        best = better
    return best


def _doubles(poles: ComplexArray) -> list[int]:
    """Indices of poles that lie within a tenth of their decay of another one."""
    apart = np.abs(poles[:, None] - poles) + np.diag(np.full(len(poles), np.inf))
    return [int(k) for k in np.flatnonzero(apart.min(axis=1) < _COINCIDENT * -poles.real)]


def _peaks(lines: Lines) -> ComplexArray:
    """Poles (rad/s) at the peaks that are well above the noise, with a prominence of 3 dB, and a real one.

    The real one, below the band, represents what lies there.
    """
    power = np.abs(lines.H) ** 2
    at = peaks(10 * np.log10(np.maximum(power, 100.0)), prominence=3.0)
    width = {top: half_width(power, top) for top in at} or {int(power.argmax()): 1.0}
    highest = sorted(width, key=lambda top: -power[top])[: _MOST_POLES // 2]
    decay = np.clip([width[top] for top in highest], 0.3, 30) * lines.spacing * lines.block
    pairs = -np.pi * decay + 2j * np.pi * lines.centres[highest]
    return np.append(pairs, -2 * np.pi * lines.f[0] / 5)


def _refined(poles: ComplexArray, lines: Lines, steps: int = _STEPS, settled: float = _SETTLED) -> Projection:
    """Refine poles to minimise the squared residual; residues are eliminated at each step.

    Levenberg-Marquardt steps with variable projection and Kaufman's Jacobian (Golub and Pereyra, Inverse
    Problems 19, 2003). Logarithms of decay and frequency keep every pole stable.
    """
    poles = np.concatenate([poles[poles.imag > 0], poles[poles.imag == 0]])
    best, trust = Projection.of(_moved(poles, np.zeros(2 * len(poles)), lines), lines), _TRUST
    for _ in range(steps):
        change = best.slope()
        seen = best.basis @ change.T
        normal = change @ change.T - seen.T @ (best.inverse @ seen)
        gradient = change @ best.left
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        normal, gradient = normal / np.outer(scale, scale), gradient / scale
        before = best.power
        for _ in range(_TRIES):
            step = np.linalg.solve(normal + trust * np.eye(len(scale)), gradient)
            foreseen = float(step @ gradient + trust * step @ step) / len(lines.H)
            if foreseen < settled * before:
                break
            tried = Projection.of(_moved(best.poles, step / scale, lines), lines)
            kept = (before - tried.power) / foreseen
            if kept > _AS_FORESEEN:
                trust = max(trust / 10, 1e-9)
            elif not kept > _LESS_THAN_FORESEEN:
                trust = max(10 * trust, 1e-4)
            if kept > 0:
                best = tried
                break
        if best.power > (1 - settled) * before:
            break
    return best


def _moved(poles: ComplexArray, step: FloatArray, lines: Lines) -> ComplexArray:
    """Poles after a step of logarithms, each of which is limited to where the linearisation may hold."""
    count = int((poles.imag > 0).sum())
    w, narrowest = 2 * np.pi * lines.f, _NARROWEST * np.pi * lines.spacing
    by_decay = np.concatenate([step[:count], step[2 * count :][: len(poles) - count]])
    decay = np.clip(-poles.real * np.exp(np.clip(by_decay, -1, 1)), narrowest, 3 * w[-1])
    moved = -decay.astype(np.complex128)
    own = poles.imag[:count]
    most = np.minimum(np.maximum(-2 * poles.real[:count], 2 * np.pi * lines.spacing) / own, 1)
    moved[:count] += 1j * np.clip(
        own * np.exp(np.clip(step[count : 2 * count], -most, most)), w[0] / 10, 3 * w[-1]
    )
    return np.asarray(moved)


_SHARE = 0.5
"""Part of the response that a resonance makes up at its own frequency, at least."""
_SUPPORT = 5
"""Neighbouring lines at which it does: with its four parameters, a pole pair fits any two lines."""
_ENERGY = 25.0
"""Energy of a resonance over the power of the noise; pairs are added to a fit from 8 on."""
_ONE = 1.5
"""Distance (lines) of two pole pairs up to which they are one resonance."""
_STANDS = 3.0
"""Deviations by which a response stands out where it resonates."""
_BESIDE_HZ = 2.0
"""Distance (Hz) up to which a resonance may be a tone of the background."""
_DAMPED = 0.3
"""Damping ratio beyond which a pole pair makes no peak."""


def resonant(fit: Projection) -> BoolArray:
    """Find the pole pairs (poles,) that are resonances; the others describe what is left of the response.

    A resonance makes up half of the response at five neighbouring lines around its frequency, or more, has
    far more energy than a pair needs to be added, and is not within three lines of the band's ends. Pairs
    whose distance is less than their decay, or than one and a half lines, are one resonance, the strongest.
    """
    lines, poles = fit.lines, fit.poles
    paired = poles.imag > 0
    count, rows = int(paired.sum()), len(lines.H)
    scaled = fit.solution[: 2 * count] * fit.norms[: 2 * count]
    parts = scaled[:count, None] * fit.basis[:count] + scaled[count:, None] * fit.basis[count : 2 * count]
    sizes = np.hypot(parts[:, :rows], parts[:, rows:])
    whole = np.abs(lines.H - fit.residual)
    noise = float(np.median(np.abs(fit.residual) ** 2)) / np.log(2)
    strong = (sizes**2).sum(axis=1) > _ENERGY * noise
    found: list[int] = []
    index = np.flatnonzero(paired)
    for own in np.argsort(-sizes.max(axis=1)):
        if not strong[own]:
            continue
        p = poles[index[own]]
        nearest = int(np.argmin(np.abs(lines.f - p.imag / (2 * np.pi))))
        inside = lines.f[2] < p.imag / (2 * np.pi) < lines.f[-3]
        if not inside or -p.real > _DAMPED * abs(p) or _run(sizes[own] >= _SHARE * whole, nearest) < _SUPPORT:
            continue
        others = poles[found]
        apart = np.maximum(np.minimum(-p.real, -others.real), _ONE * 2 * np.pi * lines.spacing)
        if np.all(np.abs(p - others) > apart):
            found.append(int(index[own]))
    mask = np.zeros(len(poles), dtype=np.bool_)
    mask[found] = True
    return mask


def stands_out(response: Response, poles: ComplexArray) -> BoolArray:
    """(poles,): true where a response around a pole is more than what its plays do not agree on.

    A machine near the table moves the laser, or its signal, and not with the drive: repeats differ by as much
    as it seems to answer (a tone in two of three repeats stands out by two deviations at most). Beside a tone
    that was heard between the plays, the levels have to agree as well. A response of which nothing is known
    stands out.
    """
    f, hz = response.frequencies, np.abs(poles.imag) / (2 * np.pi)
    scatter = response.scatter if len(response.scatter) else response.deviation
    if not len(scatter):
        return np.ones(len(poles), dtype=np.bool_)
    beside = np.any(np.abs(response.tones.unsteady[:, None] - hz) < _BESIDE_HZ, axis=0)
    at = np.argmin(np.abs(f - hz[:, None]), axis=1)
    power, scattered, deviated = (
        scipy.ndimage.uniform_filter1d(np.abs(row) ** 2, _SUPPORT, mode="nearest")[at]
        for row in (response.velocity, scatter, response.deviation)
    )
    return np.asarray(power > _STANDS**2 * np.where(beside, deviated, scattered))


def _run(true: BoolArray, at: int) -> int:
    """Length of the run of true values around an index."""
    if not true[at]:
        return 0
    after, before = np.flatnonzero(~true[at:]), np.flatnonzero(~true[: at + 1][::-1])
    return int((after[0] if len(after) else len(true) - at) + (before[0] if len(before) else at + 1) - 1)


def decay_deviation(fit: Projection) -> FloatArray:
    """Standard deviation (poles,) rad/s of the poles' real parts, from the residual.

    Each line counts with its own residual, which is not alike everywhere, over what the fit has left of it
    (the estimate HC3 of MacKinnon and White, Journal of Econometrics 29, 1985).
    """
    paired = fit.poles.imag > 0
    slope = fit.slope()
    slope /= np.maximum(np.linalg.norm(slope, axis=1), 1e-300)[:, None]
    both = np.concatenate([fit.basis, slope])
    inverse = np.linalg.inv(both @ both.T + 1e-12 * np.eye(len(both)))
    gains = inverse @ both
    kept = np.clip(1 - np.einsum("ij,ij->j", both, gains), 0.1, 1)
    spread = np.sqrt(((gains * (fit.left / kept)) ** 2).sum(axis=1) * len(fit.lines.H) / fit.independent)
    count, first = int(paired.sum()), len(fit.basis)
    deviation = np.empty(len(fit.poles))
    own = spread[first:] / np.maximum(np.linalg.norm(fit.slope(), axis=1), 1e-300)
    deviation[paired], deviation[~paired] = own[:count], own[2 * count :]
    return np.asarray(deviation * -fit.poles.real)
