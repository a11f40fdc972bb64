"""The poles of a response: rational functions fitted in the least-squares sense, their order by the data."""

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
"""Of vector fitting, which the refinement takes over from."""
_STEPS, _LAST = 12, 30
"""Of refinement: while the order is looked for, and in the end."""
_PENALTY = 4.0
"""Of a real parameter, in the residual's log-likelihood times two: between Akaike's 2 and the logarithm
of the number of lines, because a pole that may stand anywhere finds more noise than one that may not."""
_STARTS = (0, 4)
"""Pole pairs more than there are peaks, of the vector fits that it begins with."""
_DAMPINGS = (0.004, 0.012, 0.04)
"""Of the pole pairs that are looked for in what a fit leaves."""
_NOISY = 1.5
"""Power of what is left, over the noise that is known, up to which it is taken for noise."""
_COINCIDENT = 0.1
"""Distance of two poles, over their decay, within which one response cannot tell them apart."""
_NARROWEST = 0.15
"""Half-power width of a resonance, over the lines' spacing: a narrower one would hide between lines."""
_ALIKE = 30
"""Neighbouring lines whose noise may be alike."""
_PLACES = 300
"""Frequencies at which they are looked for."""
_ENOUGH = 1000
"""Lines beyond which neighbouring ones are put together."""


@dataclass(frozen=True, eq=False)
class Lines:
    """A response: `f` (lines,) Hz, `H` (rows,), of noise power one.

    Rows are lines or, with a `block`, sums of so many over the root of their number.
    """

    f: FloatArray
    H: ComplexArray
    block: int = 1

    @property
    def centres(self) -> FloatArray:
        """Frequencies (rows,) of the rows of `H`."""
        return np.asarray(self.f.reshape(-1, self.block).mean(axis=1))

    def gathered(self, values: ComplexArray) -> ComplexArray:
        """Values (lines, columns) as the rows of `H` are made."""
        return np.asarray(values.reshape(-1, self.block, *values.shape[1:]).sum(axis=1) / np.sqrt(self.block))


def fit_poles(lines: Lines) -> ComplexArray:
    """Poles (rad/s), one of each conjugate pair.

    Vector fitting (scikit-rf) begins with a pole pair for each peak. It is refined to least squares; then
    a pair is added where it explains most of what is left, for as long as that gains more than its
    parameters cost.
    """
    lines = _averaged(lines)
    with threadpool_limits(1):
        best, *others = (_tried(_vector_fit(lines, _peaks(lines) + more), lines) for more in _STARTS)
        for other in others:
            best = other if other.gain_over(best) > 0 else best
        while len(best.poles) < _MOST_PAIRS:
            # One where most is left; when that is no gain, all of them anew.
            for start in (_with_missing, _anew):
                found = _tried(start(best.poles, lines), lines)
                if found.worth_over(best):
                    best = found
                    break
            else:
                break
        return _refine(_pruned(best, lines), lines, _LAST)


def residues(poles: ComplexArray, lines: Lines) -> tuple[FloatArray, ComplexArray]:
    """Real unknowns (unknowns,) for given poles, and what they leave (rows,).

    Unknowns are the residues' real parts, the imaginary parts of those of pole pairs, a constant
    and a slope.
    """
    return _Projection.of(poles, lines).solution()


@dataclass(frozen=True, eq=False)
class _Projection:
    """The basis of some poles on some lines, real and orthonormal, and what it leaves (2 rows,)."""

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
        # Two poles that coincide leave a corner of zeros: least squares of the least norm.
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
    """Poles, and what they leave: its power a row, and how many of the rows are independent."""

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
        """Twice the gain in log-likelihood, less what more parameters cost.

        Noise may be alike in neighbouring lines, as it is after smoothing; then so many fewer count.
        What they are is told by the fit that leaves less: the other's residual is not noise alone.
        """
        independent = min((self, other), key=lambda fit: fit.power).independent
        gained = 2 * independent * float(np.log(other.power / self.power))
        return gained - _PENALTY * (self.parameters - other.parameters)

    def worth_over(self, other: _Fit) -> bool:
        """Whether it gains, and leaves noise, or a quarter less: no table is what distortion leaves."""
        return self.gain_over(other) > 0 and self.power < max(_NOISY, 0.75 * other.power)


def _anew(poles: ComplexArray, lines: Lines) -> ComplexArray:
    """Vector fitting with two pole pairs more."""
    return _vector_fit(lines, len(poles) + 2)


def _with_missing(poles: ComplexArray, lines: Lines) -> ComplexArray:
    """And the pole (rad/s) that would explain most of what `poles` leave."""
    places = 2 * np.pi * np.linspace(lines.f[0], lines.f[-1], _PLACES)
    candidates = np.concatenate([places * (1j * np.sqrt(1 - z**2) - z) for z in _DAMPINGS])
    shape = lines.gathered(1 / (2j * np.pi * lines.f[:, None] - candidates))
    shape /= np.linalg.norm(shape, axis=0)
    explained = np.abs(shape.conj().T @ residues(poles, lines)[1])
    return np.append(poles, candidates[int(np.argmax(explained))])


def _tried(start: ComplexArray, lines: Lines) -> _Fit:
    return _Fit.of(_refine(start, lines), lines)


def _pruned(best: _Fit, lines: Lines) -> ComplexArray:
    """Without the pole pairs that gain less than they cost, and without the doubles of others.

    A fit can hold two pairs that nearly coincide and cancel, each far larger than the resonance that they
    make together. Such a fit is a local minimum, and the pair whose absence leaves least is another one.
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
    """Neighbouring lines in one, response and basis alike: nothing is bent, and there is less to solve."""
    block = len(lines.f) // _ENOUGH
    if block < 2:
        return lines
    kept = len(lines.f) // block * block
    own = Lines(lines.f[:kept], lines.H[:kept], block)
    return Lines(own.f, own.gathered(own.H), block)


def _peaks(lines: Lines) -> int:
    """Peaks that stand 3 dB above what is beside them and well above the noise; 2 to 16."""
    power = np.maximum(np.abs(lines.H) ** 2, 100.0)
    return int(np.clip(len(find_peaks(10 * np.log10(power), prominence=3.0)[0]), 2, 16))


class _Responses(Network):  # type: ignore[misc]
    """No scattering matrix: whether it is passive means nothing, and takes long to find out."""

    def is_passive(self, *_: object) -> bool:
        return False


def _vector_fit(lines: Lines, pairs: int) -> ComplexArray:
    """Poles (rad/s), one of each conjugate pair, of scikit-rf's vector fit begun with `pairs` pairs."""
    H = lines.H[:, None, None] / np.abs(lines.H).max()
    fitting = VectorFitting(_Responses(frequency=Frequency.from_f(lines.centres, unit="hz"), s=H))
    fitting.max_iterations = _ITERATIONS
    with warnings.catch_warnings():
        # It warns when it has not converged; the residual says so better, and is looked at.
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
    # A mirrored pole has the same magnitude: stability costs phase only, and the refinement sees it.
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
    """Poles that minimise the squared residual, the residues being solved for at each step.

    Vector fitting minimises a weighted stand-in for the residual, and noise biases it. This is
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
