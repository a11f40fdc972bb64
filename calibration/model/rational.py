"""The poles of a response: least-squares fit of a rational function, with an order selected from the data."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.fft import fft, ifft
from scipy.optimize import least_squares
from scipy.signal import find_peaks
from skrf import Frequency, Network
from skrf.vectorFitting import VectorFitting
from threadpoolctl import threadpool_limits

from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = ["Lines", "complex_residues", "fit_poles", "residues"]

_MOST_PAIRS = 40
_ITERATIONS = 12
"""Iterations of vector fitting, which the refinement continues."""
_STEPS, _LAST = 12, 30
"""Steps of refinement during the search for the order, and of the last one."""
_PENALTY = 4.0
"""Cost of a real parameter in twice the log-likelihood: between Akaike's 2 and the logarithm of the number
of lines, because a pole with a free frequency fits more noise than a linear parameter."""
_STARTS = (0, 4)
"""Pole pairs of the initial vector fits, in excess of the number of peaks."""
_DAMPINGS = (0.004, 0.012, 0.04)
"""Damping ratios of the candidate pole pairs for the residual of a fit."""
_NOISY = 1.5
"""Power of the residual, over the known noise, up to which it counts as noise."""
_COINCIDENT = 0.1
"""Distance of two poles, over their decay, within which one response cannot distinguish them."""
_NARROWEST = 0.15
"""Smallest half-power width of a resonance, over the lines' spacing: lines do not resolve a narrower one."""
_ALIKE = 30
"""Largest distance (lines) at which noise may be correlated."""
_PLACES = 300
"""Frequencies of the candidate pole pairs."""
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

    @property
    def centres(self) -> FloatArray:
        """Frequencies (rows,) of the rows of `H`."""
        return np.asarray(self.f.reshape(-1, self.block).mean(axis=1))

    def gathered(self, values: ComplexArray) -> ComplexArray:
        """Combine values (lines, columns) into rows, as in `H`."""
        return np.asarray(values.reshape(-1, self.block, *values.shape[1:]).sum(axis=1) / np.sqrt(self.block))


def fit_poles(lines: Lines) -> ComplexArray:
    """Fit the poles (rad/s), one of each conjugate pair.

    Vector fitting (scikit-rf) begins with a pole pair for each peak, and is refined by least squares. Then
    the pair that explains most of the residual is added, as long as it gains more than its parameters
    cost.
    """
    lines = _averaged(lines)
    with threadpool_limits(1):
        best, *others = (_tried(_vector_fit(lines, _peaks(lines) + more), lines) for more in _STARTS)
        for other in others:
            best = other if other.gain_over(best) > 0 else best
        while len(best.poles) < _MOST_PAIRS:
            # Add the pair that explains most of the residual; without a gain, repeat the vector fit.
            for start in (_with_missing, _anew):
                found = _tried(start(best.poles, lines), lines)
                if found.worth_over(best):
                    best = found
                    break
            else:
                break
        return _refine(_pruned(best, lines), lines, _LAST)


def residues(poles: ComplexArray, lines: Lines) -> tuple[FloatArray, ComplexArray]:
    """Solve for the real unknowns (unknowns,) of given poles; returns them and the residual (rows,).

    Unknowns are the residues' real parts, the imaginary parts of those of pole pairs, a constant
    and a slope.
    """
    return _Projection.of(poles, lines).solution()


@dataclass(frozen=True, eq=False)
class _Projection:
    """Projection of a response on a real, orthonormal basis; `left` is the residual (2 rows,)."""

    poles: ComplexArray
    lines: Lines
    q: FloatArray
    upper: FloatArray
    norms: FloatArray
    seen: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, poles: ComplexArray, lines: Lines) -> _Projection:
        basis = lines.gathered(_columns(poles, lines.f))
        norms = np.linalg.norm(basis, axis=0)
        q, upper = np.linalg.qr(_stack(basis / norms))
        measured = _stack(lines.H)
        seen = q.T @ measured
        return cls(poles, lines, q, upper, norms, seen, measured - q @ seen)

    def solution(self) -> tuple[FloatArray, ComplexArray]:
        # Coincident poles make the triangle singular: the minimum-norm solution is taken.
        found = np.linalg.lstsq(self.upper, self.seen, rcond=None)[0] / self.norms
        count = len(self.lines.H)
        return np.asarray(found), np.asarray(self.left[:count] + 1j * self.left[count:])

    def slope(self) -> FloatArray:
        """Jacobian (2 rows, parameters) of `left` by the parameters of `_refine`."""
        p = self.poles
        paired = p.imag > 0
        s = 2j * np.pi * self.lines.f[:, None]
        near, mirror = 1 / (s - p) ** 2, np.where(paired, 1 / (s - np.conj(p)) ** 2, 0)
        own = complex_residues(p, self.solution()[0])
        one, other = own * near, np.conj(own) * mirror
        by_decay, by_frequency = (one + other) * p.real, (1j * (one - other) * p.imag)[:, paired]
        change = _stack(-self.lines.gathered(np.concatenate([by_decay, by_frequency], axis=1)))
        return np.asarray(change - self.q @ (self.q.T @ change))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Poles, the power of their residual per row, and the number of independent rows."""

    poles: ComplexArray
    power: float
    independent: float
    parameters: int

    @classmethod
    def of(cls, poles: ComplexArray, lines: Lines) -> _Fit:
        left = residues(poles, lines)[1]
        count, power = len(left), float((np.abs(left) ** 2).sum())
        alike = ifft(np.abs(fft(left, 2 * count)) ** 2)[1:_ALIKE] / power
        independent = count / float(1 + 2 * (np.abs(alike) ** 2).sum())
        return cls(poles, power / count, independent, 4 * len(poles) + 2)

    def gain_over(self, other: _Fit) -> float:
        """Twice the gain in log-likelihood, less the cost of additional parameters.

        Noise may be correlated between neighbouring lines, for example by smoothing, which reduces the
        number of independent ones. It is taken from the fit with the smaller residual, because the
        residual of the other is not noise alone.
        """
        independent = min((self, other), key=lambda fit: fit.power).independent
        gained = 2 * independent * float(np.log(other.power / self.power))
        return gained - _PENALTY * (self.parameters - other.parameters)

    def worth_over(self, other: _Fit) -> bool:
        """True when it gains, and leaves only noise or a quarter less: a smaller gain may be distortion."""
        return self.gain_over(other) > 0 and self.power < max(_NOISY, 0.75 * other.power)


def _anew(poles: ComplexArray, lines: Lines) -> ComplexArray:
    """Repeat vector fitting with two more pole pairs."""
    return _vector_fit(lines, len(poles) + 2)


def _with_missing(poles: ComplexArray, lines: Lines) -> ComplexArray:
    """Append to `poles` the pole (rad/s) that explains most of their residual."""
    places = 2 * np.pi * np.linspace(lines.f[0], lines.f[-1], _PLACES)
    candidates = np.concatenate([places * (1j * np.sqrt(1 - z**2) - z) for z in _DAMPINGS])
    shape = lines.gathered(1 / (2j * np.pi * lines.f[:, None] - candidates))
    shape /= np.linalg.norm(shape, axis=0)
    explained = np.abs(shape.conj().T @ residues(poles, lines)[1])
    return np.append(poles, candidates[int(np.argmax(explained))])


def _tried(start: ComplexArray, lines: Lines) -> _Fit:
    return _Fit.of(_refine(start, lines), lines)


def _pruned(best: _Fit, lines: Lines) -> ComplexArray:
    """Remove the pole pairs that gain less than they cost, and those that nearly coincide with others.

    A fit can contain two pairs that nearly coincide and cancel, each far larger than their sum. Such a fit
    is a local minimum, and the pair whose removal increases the residual least is a different one, so
    coincident pairs are tried separately.
    """
    while len(best.poles) > 1:
        fewer = [_Fit.of(np.delete(best.poles, k), lines) for k in range(len(best.poles))]
        candidates = [min(fewer, key=lambda fit: fit.power), *(fewer[k] for k in _doubles(best.poles))]
        tried = (_tried(fit.poles, lines) for fit in candidates)
        better = next((fit for fit in tried if fit.gain_over(best) > 0), None)
        if better is None:
            break
        best = better
    return best.poles


def _doubles(poles: ComplexArray) -> list[int]:
    """Indices of poles that lie within a tenth of their decay of another one."""
    apart = np.abs(poles[:, None] - poles) + np.diag(np.full(len(poles), np.inf))
    return [int(k) for k in np.flatnonzero(apart.min(axis=1) < _COINCIDENT * -poles.real)]


def _averaged(lines: Lines) -> Lines:
    """Average neighbouring lines. The basis is averaged alike, so that this adds no bias and saves time."""
    block = len(lines.f) // _ENOUGH
    if block < 2:
        return lines
    kept = len(lines.f) // block * block
    own = Lines(lines.f[:kept], lines.H[:kept], block)
    return Lines(own.f, own.gathered(own.H), block)


def _peaks(lines: Lines) -> int:
    """Number of peaks with a prominence of 3 dB that are well above the noise; 2 to 16."""
    power = np.maximum(np.abs(lines.H) ** 2, 100.0)
    return int(np.clip(len(find_peaks(10 * np.log10(power), prominence=3.0)[0]), 2, 16))


class _Responses(Network):  # type: ignore[misc]
    """Network that skips scikit-rf's slow test for passivity, which has no meaning for these responses."""

    def is_passive(self, *_: object) -> bool:
        return False


def _vector_fit(lines: Lines, pairs: int) -> ComplexArray:
    """Poles (rad/s), one of each conjugate pair, of scikit-rf's vector fit begun with `pairs` pairs."""
    H = lines.H[:, None, None] / np.abs(lines.H).max()
    fitting = VectorFitting(_Responses(frequency=Frequency.from_f(lines.centres, unit="hz"), s=H))
    fitting.max_iterations = _ITERATIONS
    with warnings.catch_warnings():
        # Its convergence warning is not needed: fits are judged by their residuals.
        warnings.simplefilter("ignore")
        fitting.vector_fit(
            n_poles_real=0,
            n_poles_cmplx=pairs,
            init_pole_spacing="lin",
            fit_constant=True,
            fit_proportional=True,
            enforce_dc=False,
        )
    poles = np.asarray(fitting.poles, dtype=np.complex128)
    # A mirrored pole has the same magnitude: only the phase changes, which the refinement corrects.
    return np.asarray(-np.abs(poles.real) + 1j * poles.imag)


def _columns(poles: ComplexArray, f: FloatArray) -> ComplexArray:
    """Basis (lines, unknowns) of real unknowns."""
    s = 2j * np.pi * f[:, None]
    paired = poles.imag > 0
    near, mirror = 1 / (s - poles), 1 / (s - np.conj(poles))
    return np.concatenate(
        [
            near + np.where(paired, mirror, 0),
            (1j * (near - mirror))[:, paired],
            np.ones_like(s),
            s,
        ],
        axis=1,
    )


def _stack(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])


def complex_residues(poles: ComplexArray, solution: FloatArray) -> ComplexArray:
    """(poles,) from the unknowns of `residues`."""
    found = solution[: len(poles)].astype(np.complex128)
    paired = poles.imag > 0
    found[paired] += 1j * solution[len(poles) : len(poles) + int(paired.sum())]
    return found


def _refine(poles: ComplexArray, lines: Lines, steps: int = _STEPS) -> ComplexArray:
    """Refine poles to minimise the squared residual; residues are eliminated at each step.

    Vector fitting minimises a weighted substitute for the residual, which noise biases. This is
    variable projection with Kaufman's Jacobian (Golub and Pereyra, Inverse Problems 19, 2003).
    Logarithms of decay and frequency, within a factor e, keep every pole stable.
    """
    paired = poles.imag > 0

    def at(x: FloatArray) -> ComplexArray:
        p = -np.exp(x[: len(poles)]).astype(np.complex128)
        p[paired] += 1j * np.exp(x[len(poles) :])
        return p

    latest: list[tuple[bytes, _Projection]] = []

    def projected(x: FloatArray) -> _Projection:
        if not latest or latest[0][0] != x.tobytes():
            latest[:] = [(x.tobytes(), _Projection.of(at(x), lines))]
        return latest[0][1]

    def left(x: FloatArray) -> FloatArray:
        return projected(x).left

    def slope(x: FloatArray) -> FloatArray:
        return projected(x).slope()

    spacing = float(np.median(np.diff(lines.f)))
    narrowest = np.log(_NARROWEST * np.pi * spacing)
    start = np.concatenate([np.maximum(np.log(-poles.real), narrowest), np.log(poles.imag[paired])])
    low, high = start - 1, start + 1
    low[: len(poles)] = np.maximum(low[: len(poles)], narrowest - 1e-3)
    found = least_squares(left, start, slope, (low, high), method="trf", max_nfev=steps, xtol=1e-9, ftol=1e-5)
    return at(found.x)
