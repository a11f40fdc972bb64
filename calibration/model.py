"""A stable rational transfer function fitted to a measured response."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import find_peaks
from skrf import Frequency, Network
from skrf.vectorFitting import VectorFitting
from threadpoolctl import threadpool_limits

from calibration.response import Response
from instruments import DataError
from instruments.arrays import ComplexArray, FloatArray

__all__ = ["Model", "Resonance", "fit"]

_MOST_PAIRS = 40
_STEP = 2
"""Orders that are tried: from as many pole pairs as there are peaks, in steps of two."""
_ITERATIONS = 12
"""Of vector fitting, which the refinement takes over from."""
_WORTH = 0.5
"""Share of the residual's power above the noise that a larger order must leave at most."""
_NOISE = 0.03
"""Power above the noise, over the noise, that is taken for nothing: twice what chance makes it."""
_PATIENCE = 2
"""Orders without improvement after which larger ones are not tried: two close modes need both."""


@dataclass(frozen=True)
class Resonance:
    """One pole pair: natural frequency |s| / 2 pi, damping ratio, and strength (its own peak, m/s/V)."""

    frequency_hz: float
    damping: float
    strength: float


@dataclass(frozen=True, eq=False)
class Model:
    """Velocity per volt at the patch as a sum of partial fractions, a constant and a slope.

    `poles` and `residues` hold one of each conjugate pair (imaginary part >= 0); a real pole
    stands for itself. H(s) = sum(r / (s - p) + conj) + constant + slope s. The last two stand for
    what the modes above the band do within it, and are believed within `band` (Hz) only.
    """

    poles: ComplexArray
    residues: ComplexArray
    constant: float
    slope: float
    band: tuple[float, float]
    error: float
    """Relative rms difference from the measured response over the band."""

    @property
    def stable(self) -> bool:
        """Whether every pole lies in the left half plane."""
        return bool(np.all(self.poles.real < 0))

    @property
    def resonances(self) -> tuple[Resonance, ...]:
        """All pole pairs within the band, by frequency."""
        found = [
            Resonance(abs(p) / (2 * np.pi), -p.real / abs(p), abs(r) / -p.real)
            for p, r in zip(self.poles, self.residues, strict=True)
            if p.imag > 0 and self.band[0] < abs(p) / (2 * np.pi) < self.band[1]
        ]
        return tuple(sorted(found, key=lambda r: r.frequency_hz))

    @property
    def resonance_hz(self) -> float:
        """The resonance that is strongest in velocity (Hz): the paper's carrier frequency."""
        return max(self.resonances, key=lambda r: r.strength).frequency_hz

    def velocity(self, frequencies: FloatArray) -> ComplexArray:
        """m/s per V at the patch at `frequencies` (Hz)."""
        s = 2j * np.pi * np.asarray(frequencies, dtype=np.float64)
        H = self.constant + self.slope * s
        for p, r in zip(self.poles, self.residues, strict=True):
            H = H + r / (s - p)
            if p.imag > 0:
                H = H + np.conj(r) / (s - np.conj(p))
        return np.asarray(H)


def fit(response: Response) -> Model:
    """Vector fitting (scikit-rf) of the velocity, refined to least squares; the order by the data.

    The sweep's noise is nearly the same on every line of the velocity, so that all lines weigh
    alike. Orders grow until the residual is the noise that the repeats show, or until further poles
    no longer halve what is above it: they would describe noise, or what is no table. Raises
    DataError when no resonance is found.
    """
    f, H = response.frequencies, response.velocity
    scale = float(np.abs(H).max())
    noise = float(np.mean(response.deviation**2)) / scale**2
    best: tuple[float, ComplexArray] | None = None
    failures = 0
    with threadpool_limits(1):
        for pairs in range(_peaks(response), _MOST_PAIRS, _STEP):
            poles = _refine(_vector_fit(f, H / scale, pairs), f, H / scale)
            excess = float(np.mean(np.abs(_residues(poles, f, H / scale)[1]) ** 2)) - noise
            if best is None or excess < _WORTH * best[0]:
                best, failures = (excess, poles), 0
            else:
                failures += 1
            if failures == _PATIENCE or excess < _NOISE * noise:
                break
        assert best is not None
        poles = best[1]
        solution, rest = _residues(poles, f, H / scale)
    model = _model(poles, solution * scale, response, float(np.linalg.norm(rest) * scale / np.linalg.norm(H)))
    if not model.stable or not model.resonances:
        raise DataError(
            f"No resonance of patch {response.patch} at the {response.point} point could be fitted: "
            "look at the measured response."
        )
    return model


def _peaks(response: Response) -> int:
    """Peaks that stand 3 dB above what is beside them and well above the noise; 2 to 16."""
    level = 20 * np.log10(np.maximum(np.abs(response.velocity), 10 * response.deviation))
    return int(np.clip(len(find_peaks(level, prominence=3.0)[0]), 2, 16))


def _vector_fit(f: FloatArray, H: ComplexArray, pairs: int) -> ComplexArray:
    """Poles (rad/s), one of each conjugate pair, of scikit-rf's vector fit begun with `pairs` pairs."""
    fitting = VectorFitting(Network(frequency=Frequency.from_f(f, unit="hz"), s=H[:, None, None]))
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


def _columns(poles: ComplexArray, f: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Basis (lines, unknowns) of real unknowns, and each column's norm for conditioning."""
    s = 2j * np.pi * f[:, None]
    paired = poles.imag > 0
    near, mirror = 1 / (s - poles), 1 / (s - np.conj(poles))
    basis = np.concatenate(
        [
            near + np.where(paired, mirror, 0),
            (1j * (near - mirror))[:, paired],
            np.ones_like(s),
            s,
        ],
        axis=1,
    )
    return basis, np.linalg.norm(basis, axis=0)


def _stack(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])


def _residues(poles: ComplexArray, f: FloatArray, H: ComplexArray) -> tuple[FloatArray, ComplexArray]:
    """The real unknowns of `_columns` in the least-squares sense, and what they leave of H."""
    basis, norms = _columns(poles, f)
    solution = np.linalg.lstsq(_stack(basis / norms), _stack(H), rcond=None)[0] / norms
    return np.asarray(solution), np.asarray(H - basis @ solution)


def _complex_residues(poles: ComplexArray, solution: FloatArray) -> ComplexArray:
    residues = solution[: len(poles)].astype(np.complex128)
    paired = poles.imag > 0
    residues[paired] += 1j * solution[len(poles) : len(poles) + int(paired.sum())]
    return residues


def _refine(poles: ComplexArray, f: FloatArray, H: ComplexArray) -> ComplexArray:
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

    def rest(x: FloatArray) -> FloatArray:
        return _stack(_residues(at(x), f, H)[1])

    def slope(x: FloatArray) -> FloatArray:
        p = at(x)
        solution, _ = _residues(p, f, H)
        r = _complex_residues(p, solution)
        s = 2j * np.pi * f[:, None]
        near, mirror = r / (s - p) ** 2, np.where(paired, np.conj(r) / (s - np.conj(p)) ** 2, 0)
        change = _stack(
            -np.concatenate([(near + mirror) * p.real, (1j * (near - mirror) * p.imag)[:, paired]], axis=1)
        )
        basis, norms = _columns(p, f)
        q, _ = np.linalg.qr(_stack(basis / norms))
        return np.asarray(change - q @ (q.T @ change))

    start = np.concatenate([np.log(-poles.real), np.log(poles.imag[paired])])
    found = least_squares(
        rest, start, slope, (start - 1, start + 1), method="trf", max_nfev=12, xtol=1e-9, ftol=1e-7
    )
    return at(found.x)


def _model(poles: ComplexArray, solution: FloatArray, response: Response, error: float) -> Model:
    return Model(
        poles=poles,
        residues=_complex_residues(poles, solution),
        constant=float(solution[-2]),
        slope=float(solution[-1]),
        band=(float(response.frequencies[0]), float(response.frequencies[-1])),
        error=error,
    )
