"""The poles of a response: least-squares fit of a rational function, with an order selected from the data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.fft import fft, ifft
from threadpoolctl import threadpool_limits

from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = ["Lines", "Projection", "fit_poles"]

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
_ALIKE = 30
"""Largest distance (lines) at which noise may be correlated."""
_ENOUGH = 1000
"""Number of lines above which neighbouring ones are averaged."""


@dataclass(frozen=True, eq=False)
class Lines:
    """A response: `f` (lines,) Hz, and `H` (rows,), scaled to a noise power of one.

    Each row is the sum of `block` lines over the root of `block`, which leaves the noise power at one.
    """

    f: FloatArray
    H: ComplexArray
    block: int = 1

    @cached_property
    def spacing(self) -> float:
        """Median distance of neighbouring lines (Hz)."""
        return float(np.median(np.diff(self.f)))

    @cached_property
    def centres(self) -> FloatArray:
        """Frequencies (rows,) of the rows (Hz)."""
        return np.asarray(self.f.reshape(-1, self.block).mean(axis=1))

    def averaged(self) -> Lines:
        """Average neighbouring lines. A basis is averaged alike, so that this adds no bias and saves time."""
        block = len(self.f) // _ENOUGH
        if block < 2:
            return self
        kept = len(self.f) // block * block
        H = self.H[:kept].reshape(-1, block).sum(axis=1) / np.sqrt(block)
        return Lines(self.f[:kept], H, block)

    def gathered(self, values: FloatArray) -> FloatArray:
        """Combine real and imaginary parts (columns, 2, lines) into rows, (columns, 2 rows)."""
        if self.block > 1:
            # Twice as fast as a sum along a short axis.
            values = sum(values[:, :, k :: self.block] for k in range(self.block)) / np.sqrt(self.block)
        return np.asarray(values.reshape(len(values), -1))


@dataclass(frozen=True, eq=False)
class Projection:
    """Least-squares solution for given poles (rad/s, one of each conjugate pair).

    The response is a sum of (a + b s) / ((s - p)(s - p*)), or of a / (s - p) for real poles, a constant and
    a slope. `basis` (unknowns, 2 rows) has rows of unit norm, `norms` before: b of pairs, a of pairs, a of
    real poles, constant, slope. `inverse` is that of its Gram matrix; `left` (2 rows,) is the residual, real
    parts first.
    """

    poles: ComplexArray
    lines: Lines
    quadratic: FloatArray
    """(2, pairs, lines): real and imaginary part of 1 / ((s - p)(s - p*))."""
    basis: FloatArray
    norms: FloatArray
    inverse: FloatArray
    solution: FloatArray
    left: FloatArray
    power: float
    """Power of the residual per row."""

    @classmethod
    def of(cls, poles: ComplexArray, lines: Lines) -> Projection:
        """Solve for the linear unknowns."""
        quadratic = _inverse_quadratic(poles[poles.imag > 0], 2 * np.pi * lines.f)
        basis = _basis(poles, quadratic, lines)
        norms = np.sqrt(np.einsum("ij,ij->i", basis, basis))
        basis /= norms[:, None]
        # The tiny ridge keeps coincident poles solvable; the second pass makes up for it, and for rounding.
        inverse = np.linalg.inv(basis @ basis.T + 1e-12 * np.eye(len(norms)))
        measured = np.concatenate([lines.H.real, lines.H.imag])
        found = inverse @ (basis @ measured)
        found = found + inverse @ (basis @ (measured - found @ basis))
        left = np.asarray(measured - found @ basis)
        power = float(left @ left) / (len(left) // 2)
        return cls(
            poles,
            lines,
            quadratic,
            basis,
            norms,
            np.asarray(inverse, dtype=np.float64),
            np.asarray(found / norms),
            left,
            power,
        )

    @property
    def residual(self) -> ComplexArray:
        """The residual (rows,)."""
        count = len(self.left) // 2
        return np.asarray(self.left[:count] + 1j * self.left[count:])

    @property
    def error(self) -> float:
        """Relative rms residual."""
        return float(np.sqrt(self.power / np.mean(np.abs(self.lines.H) ** 2)))

    @cached_property
    def independent(self) -> float:
        """Number of independent rows: the residual of neighbouring lines may be correlated, by smoothing."""
        count, total = len(self.left) // 2, float(self.left @ self.left)
        alike = ifft(np.abs(fft(self.residual, 2 * count)) ** 2)[1:_ALIKE] / max(total, 1e-300)
        return count / float(1 + 2 * (np.abs(alike) ** 2).sum())

    @property
    def parameters(self) -> int:
        """Number of real parameters: four a pole pair, two a real pole, a constant and a slope."""
        return 2 * len(self.poles) + 2 * int((self.poles.imag > 0).sum()) + 2

    def residues(self) -> ComplexArray:
        """(poles,) residues."""
        paired = self.poles.imag > 0
        count = int(paired.sum())
        b, a, p = self.solution[:count], self.solution[count : 2 * count], self.poles[paired]
        found = np.empty(len(self.poles), dtype=np.complex128)
        found[paired] = (a + b * p) / (2j * p.imag)
        found[~paired] = self.solution[2 * count : -2]
        return found

    def slope(self) -> FloatArray:
        """Derivative (parameters, 2 rows) by logarithms: pairs' decay and frequency, real poles' decay."""
        paired = self.poles.imag > 0
        pairs, real = self.poles[paired], self.poles[~paired].real[:, None]
        count, w = len(pairs), 2 * np.pi * self.lines.f
        re, im = self.quadratic
        b, a = self.solution[:count, None], self.solution[count : 2 * count, None]
        # -(a + b s) / quadratic^2, times the derivatives of the quadratic: 2 (s + decay) and 2 frequency.
        square_re, square_im = re**2 - im**2, 2 * re * im
        top_re, top_im = b * w * square_im - a * square_re, -a * square_im - b * w * square_re
        d, own = -pairs.real[:, None], 2 * pairs.imag[:, None] ** 2
        slopes = np.empty((2 * count + len(real), 2, len(w)))
        slopes[:count, 0], slopes[:count, 1] = (
            2 * d * (d * top_re - w * top_im),
            2 * d * (d * top_im + w * top_re),
        )
        slopes[count : 2 * count, 0], slopes[count : 2 * count, 1] = own * top_re, own * top_im
        # -decay / (s + decay)^2
        size = real * self.solution[2 * count : -2, None] / (w**2 + real**2) ** 2
        slopes[2 * count :, 0], slopes[2 * count :, 1] = size * (real**2 - w**2), size * 2 * real * w
        return self.lines.gathered(slopes)

    def explained(self, candidates: ComplexArray) -> FloatArray:
        """Energy of the residual (candidates,) that each pair of poles would take away if it were added."""
        quadratic = _inverse_quadratic(candidates, 2 * np.pi * self.lines.f)
        added = _basis(candidates, quadratic, self.lines)[:-2].reshape(2, len(candidates), -1)
        added /= np.linalg.norm(added, axis=2)[:, :, None]
        seen = added @ self.basis.T
        gram = np.einsum("ikn,jkn->kij", added, added) - np.einsum(
            "iku,uv,jkv->kij", seen, self.inverse, seen
        )
        along = (added @ self.left).T[:, :, None]
        return np.asarray((along * np.linalg.solve(gram + 1e-9 * np.eye(2), along)).sum(axis=(1, 2)))

    def costs(self) -> FloatArray:
        """Rise of the residual's power (poles,) when a pole is removed and the others stay where they are."""
        scaled = self.solution * self.norms
        paired = self.poles.imag > 0
        count = int(paired.sum())
        first = np.where(paired, np.cumsum(paired) - 1, 2 * count + np.cumsum(~paired) - 1)
        costs = []
        for k, pair in zip(first, paired, strict=True):
            own = [k, k + count] if pair else [k]
            costs.append(scaled[own] @ np.linalg.solve(self.inverse[np.ix_(own, own)], scaled[own]))
        return np.array(costs) / (len(self.left) // 2)

    def gain_over(self, other: Projection) -> float:
        """Twice the gain in log-likelihood, less the cost of additional parameters.

        The number of independent rows is taken from the fit with the smaller residual, because the
        residual of the other is not noise alone.
        """
        independent = min((self, other), key=lambda fit: fit.power).independent
        gained = 2 * independent * float(np.log(max(other.power, 1e-300) / max(self.power, 1e-300)))
        return gained - _PENALTY * (self.parameters - other.parameters)

    def worth_over(self, other: Projection) -> bool:
        """True when it gains, and leaves only noise or clearly less: a smaller gain may be distortion."""
        pairs = max(len(self.poles) - len(other.poles), 1)
        return self.gain_over(other) > 0 and self.power < max(_NOISY, other.most_left**pairs * other.power)

    @property
    def most_left(self) -> float:
        """Largest part of the residual's power that another pair may leave."""
        return _LESS if self.error < _GOOD else _LESS_COARSE


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
            together = _refined(np.append(found.poles, missing), self.lines)
            if together.worth_over(fit):
                return together
            if len(missing) > 1 and (
                alone := _refined(np.append(found.poles, missing[:1]), self.lines)
            ).worth_over(fit):
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
        hopeless = (1 - fit.most_left) / 2.5 * fit.power * len(left)
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
        better = next((fit for fit in tried if fit.gain_over(best) > 0), None)
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
    at = scipy.signal.find_peaks(10 * np.log10(np.maximum(power, 100.0)), prominence=3.0)[0]
    step, centres = lines.spacing * lines.block, lines.centres
    width = scipy.signal.peak_widths(power, at, rel_height=0.5)[0] if len(at) else np.ones(1)
    if not len(at):
        at = np.array([int(np.argmax(power))])
    kept = np.argsort(-power[at])[: _MOST_POLES // 2]
    pairs = -np.pi * step * np.clip(width[kept], 0.3, 30) + 2j * np.pi * centres[at[kept]]
    return np.append(pairs, -2 * np.pi * lines.f[0] / 5)


def _basis(poles: ComplexArray, quadratic: FloatArray, lines: Lines) -> FloatArray:
    """Rows (unknowns, 2 rows) of the linear unknowns, as `Projection` orders them."""
    real, w = poles[poles.imag == 0].real[:, None], 2 * np.pi * lines.f
    count = quadratic.shape[1]
    basis = np.empty((2 * count + len(real) + 2, 2, len(w)))
    np.multiply(-w, quadratic[1], out=basis[:count, 0])
    np.multiply(w, quadratic[0], out=basis[:count, 1])
    basis[count : 2 * count] = quadratic.transpose(1, 0, 2)
    size = 1 / (w**2 + real**2)
    basis[2 * count : -2, 0], basis[2 * count : -2, 1] = -real * size, -w * size
    basis[-2:] = 0
    basis[-2, 0], basis[-1, 1] = 1, w
    return lines.gathered(basis)


def _inverse_quadratic(pairs: ComplexArray, w: FloatArray) -> FloatArray:
    """Real and imaginary part of 1 / ((s - p)(s - p*)) at s = j w, (2, pairs, lines)."""
    d, own = -pairs.real[:, None], pairs.imag[:, None]
    found = np.empty((2, len(pairs), len(w)))
    re, im = (own - w) * (own + w) + d**2, 2 * d * w
    size = 1 / (re * re + im * im)
    np.multiply(re, size, out=found[0])
    np.multiply(-im, size, out=found[1])
    return found


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
