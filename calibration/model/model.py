"""A stable rational transfer function fitted to a measured response, and its standard deviation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.errors import ConfigurationError, DataError
from ..band import BAND
from ..response import Response
from .projection import Lines, Projection
from .rational import decay_deviation, fit_poles, resonant, stands_out

if TYPE_CHECKING:
    from .calibration import Calibration


_FAST = 1000.0
"""Corner of the slope in state space, over the band's upper end: s alone is not proper."""
_UNKNOWN = 1e-3
"""Smallest relative noise assumed for a response without noise data."""
_FEWEST = 8
"""Lines that a fit needs at least: a pole pair, a real pole, a constant and a slope have eight parameters."""
_ALIKE = 0.9
"""Height of a peak, over the highest, from which noise, hysteresis and drift could make it the highest: each
changes a peak by some percent."""
_GRID = 2000
"""Lines on which the discrete sections are fitted to the model."""


@dataclass(frozen=True)
class Resonance:
    """One resonance: natural frequency |s| / 2 pi, damping ratio, strength (peak of its pole pair, m/s/V).

    `damping_interval` is where the damping ratio lies with 95 %. It begins at zero when the response only
    bounds the damping: the resonance is narrower than the lines' spacing, or than its uncertainty.
    """

    frequency_hz: float
    damping: float
    strength: float
    damping_interval: tuple[float, float]

    @property
    def damping_is_bound(self) -> bool:
        """True when all that is known is that the damping is at most the interval's upper end."""
        return self.damping_interval[0] == 0


@dataclass(frozen=True, eq=False)
class Model:
    """Velocity per volt at the patch as a sum of partial fractions, a constant and a slope.

    `poles` and `residues` hold one of each conjugate pair (imaginary part >= 0), and the real poles.
    H(s) = sum(r / (s - p) + conj) + constant + slope s. The last two represent the residual effect of
    the modes above the band, and hold within `band` (Hz) only. Not every pole pair is a resonance: some
    describe what the resonances leave of the measured response.
    """

    poles: ComplexArray
    residues: ComplexArray
    constant: float
    slope: float
    band: tuple[float, float]
    error: float
    """Relative rms difference from the measured response over the band."""
    resonant: BoolArray
    """(poles,): true for the pole pairs that are resonances."""
    decay_deviation: FloatArray
    """(poles,) rad/s: standard deviation of the poles' real parts."""
    spacing: float
    """Median distance of the response's lines (Hz)."""

    def __repr__(self) -> str:
        found = ", ".join(f"{one.frequency_hz:.1f}" for one in self.resonances)
        return f"<Model: resonances at {found or 'no'} Hz, {'' if self.stable else 'not '}stable>"

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for poles that no fit finds."""
        each = (self.poles, self.residues, self.resonant, self.decay_deviation)
        if np.ndim(self.poles) != 1 or any(one.shape != self.poles.shape for one in each):
            raise DataError("the model does not have one residue for each pole.")
        if not all(
            np.all(np.isfinite(one)) for one in (self.residues, self.constant, self.slope, *self.band)
        ):
            raise DataError("the model's residues, constant, slope and band are not finite.")
        if not np.all((np.abs(self.poles) > 0) & (np.abs(self.poles) < 1e9)):
            raise DataError("the model has a pole at 0, or beyond any frequency.")

    @property
    def stable(self) -> bool:
        """True when every pole lies in the left half plane."""
        return bool(np.all(self.poles.real < 0))

    @property
    def resonances(self) -> tuple[Resonance, ...]:
        """The resonances within the band, by frequency."""
        found = []
        for k in np.flatnonzero(self.resonant):
            p, natural = self.poles[k], float(abs(self.poles[k]))
            margin = 2 * float(self.decay_deviation[k])
            low = 0.0 if -p.real < np.pi * self.spacing else max(-float(p.real) - margin, 0.0)
            interval = low / natural, (margin - float(p.real)) / natural
            strength = float(abs(self.residues[k]) / -p.real)
            found.append(Resonance(natural / (2 * np.pi), -float(p.real) / natural, strength, interval))
        return tuple(sorted(found, key=lambda r: r.frequency_hz))

    @property
    def carriers(self) -> tuple[Resonance, ...]:
        """Resonances with the largest velocity response, the largest first: the first is the paper's carrier.

        Those within the band of drives, if there are any: of a press on another one a drive holds one side
        band at most. Several when others reach nine tenths of it, or could within the uncertainty of their
        damping (95 %): then another measurement may find another one the largest.
        """
        every = self.resonances
        found = [one for one in every if BAND[0] < one.frequency_hz < BAND[1]] or every
        # A peak of the response itself: residues of pole pairs that nearly coincide can cancel.
        heights = np.abs(self.velocity(np.array([r.frequency_hz for r in found])))
        spread = np.array([r.damping_interval[1] / r.damping - 1 for r in found])
        order = np.argsort(-heights)
        least = _ALIKE * heights[order[0]] / (1 + spread[order[0]])
        return tuple(found[k] for k in order if k == order[0] or heights[k] * (1 + spread[k]) >= least)

    @property
    def ambiguity(self) -> str:
        """Sentence that names all carriers; empty when there is one."""
        named = [f"{r.frequency_hz:.2f}" for r in self.carriers]
        if len(named) == 1:
            return ""
        return (
            f"The carrier is ambiguous: {', '.join(named[:-1])} and {named[-1]} Hz respond so nearly alike "
            "that another measurement may find another one the strongest."
        )

    @property
    def resonance_hz(self) -> float:
        """Resonance with the largest velocity response (Hz): the paper's carrier frequency."""
        return self.carriers[0].frequency_hz

    def velocity(self, frequencies: FloatArray) -> ComplexArray:
        """m/s per V at the patch at `frequencies` (Hz)."""
        s = 2j * np.pi * np.asarray(frequencies, dtype=np.float64)
        H = self.constant + self.slope * s
        for p, r in zip(self.poles, self.residues, strict=True):
            H = H + r / (s - p)
            if p.imag > 0:
                H = H + np.conj(r) / (s - np.conj(p))
        return np.asarray(H)

    def state_space(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A, B, C, D of x' = A x + B u, y = C x + D u: u in V at the patch, y in m/s, one input, one output.

        A consists of real modal blocks. The slope, which a state space cannot represent, rolls off with a
        pole at a thousand times the band's upper end, which changes it by 0.1 % at most within the band.
        """
        fast = 2 * np.pi * _FAST * self.band[1]
        blocks, inputs, outputs = [], [], []
        for p, r in zip(self.poles, self.residues, strict=True):
            if p.imag > 0:
                blocks.append(np.array([[p.real, p.imag], [-p.imag, p.real]]))
                inputs += [2.0, 0.0]
                outputs += [r.real, r.imag]
            else:
                blocks.append(np.array([[p.real]]))
                inputs.append(1.0)
                outputs.append(r.real)
        blocks.append(np.array([[-fast]]))
        A = np.asarray(scipy.linalg.block_diag(*blocks), dtype=np.float64)
        # The slope is a difference of two large terms: scaling by the corner keeps the state small.
        B = np.array([*inputs, fast])[:, None]
        C = np.array([*outputs, -self.slope * fast])[None, :]
        return A, B, C, np.array([[self.constant + self.slope * fast]])

    def sos(self, rate_hz: float) -> FloatArray:
        """(sections, 6) second-order sections at a sample rate, as scipy.signal.sosfilt takes them.

        Input: V at the patch; output: m/s. The poles are the model's, sampled; the numerator is fitted
        to the model over its band, to 0.1 % at rates of eight times the band and more. Zeros
        may lie outside the unit circle: then the filter is stable, but its inverse is not.
        Raises ConfigurationError for a rate below four times the band's upper end.
        """
        if not rate_hz >= 4 * self.band[1]:
            raise ConfigurationError(
                f"A model up to {self.band[1]:g} Hz cannot be sampled at {rate_hz:g} samples/s: "
                "four times its band is the least."
            )
        f = np.linspace(*self.band, _GRID)
        back = np.exp(-2j * np.pi * f / rate_hz)
        both = np.concatenate([self.poles, np.conj(self.poles[self.poles.imag > 0])])
        z = np.exp(both / rate_hz)
        first = len(self.poles)
        paired = self.poles.imag > 0
        sections = 1 / (1 - z * back[:, None])
        near, mirror = sections[:, :first], np.zeros((len(f), first), dtype=np.complex128)
        mirror[:, paired] = sections[:, first:]
        basis = np.concatenate(
            [near + mirror, (1j * (near - mirror))[:, paired], np.ones((len(f), 1)), back[:, None]], axis=1
        )
        norms = np.linalg.norm(basis, axis=0)
        stacked = np.concatenate([basis.real, basis.imag]) / norms
        H = self.velocity(f)
        solution = np.linalg.lstsq(stacked, np.concatenate([H.real, H.imag]), rcond=None)[0] / norms
        r = solution[:first].astype(np.complex128)
        r[paired] += 1j * solution[first:-2]
        return _cascade(self.poles, z, r, solution[-2:])

    def variables(self, rate_hz: float | None = None) -> dict[str, Any]:
        """The model as MATLAB has it: volts at the patch to m/s.

        A, B, C, D of the state space (s), poles (rad/s) and residues (one of each pair), constant, slope,
        band_hz and error; and with `rate_hz` sos and its rate.
        """
        A, B, C, D = self.state_space()
        values: dict[str, Any] = {
            "A": A,
            "B": B,
            "C": C,
            "D": D,
            "poles": self.poles,
            "residues": self.residues,
            "constant": self.constant,
            "slope": self.slope,
            "band_hz": np.array(self.band),
            "error": self.error,
            "input": "V at the patch",
            "output": "m/s",
        }
        if rate_hz is not None:
            values |= {"sos": self.sos(rate_hz), "rate_hz": rate_hz}
        return values


def fit(response: Response) -> Model:
    """Fit a model to a response, with an order selected from the data.

    All lines have equal weight, because their noise is nearly equal. Poles are always stable. Raises
    DataError for a response that is not finite or has too few lines, and when no resonance is found.
    """
    f, H = response.frequencies, response.velocity
    noise = _noise(response)
    lines = Lines(f, H / noise)
    poles = fit_poles(lines)
    found = Projection.of(poles, lines)
    model = Model(
        poles=poles,
        residues=noise * found.residues(),
        constant=noise * float(found.solution[-2]),
        slope=noise * float(found.solution[-1]),
        band=(float(f[0]), float(f[-1])),
        error=0.0,
        resonant=resonant(found) & stands_out(response, poles),
        decay_deviation=decay_deviation(found),
        spacing=lines.spacing,
    )
    if not model.stable or not model.resonances:
        raise DataError(f"No resonance of {_place(response)} could be fitted: look at the measured response.")
    return replace(model, error=float(np.linalg.norm(model.velocity(f) - H) / np.linalg.norm(H)))


def _place(response: Response) -> str:
    return f"patch {response.patch} at the {response.point} point"


def _noise(response: Response) -> float:
    """Root mean square of the standard deviation of a response's lines (m/s per V)."""
    f, H = response.frequencies, response.velocity
    if len(f) < _FEWEST or not np.all(np.diff(f) > 0) or not f[0] > 0:
        raise DataError(
            f"The response of {_place(response)} has {len(f)} lines: a model needs {_FEWEST} or more, "
            "in ascending order, above 0 Hz."
        )
    size = float(np.sqrt(np.mean(np.abs(H) ** 2)))
    if not np.isfinite(size) or size == 0:
        raise DataError(f"The response of {_place(response)} is zero, NaN or infinite: no model fits it.")
    # What neighbouring lines have in common is no noise to a fit.
    own = response.scatter if len(response.scatter) else response.deviation
    known = float(np.sqrt(np.mean(own**2))) if len(own) else 0.0
    if np.isfinite(known) and known > 0:
        return known
    # The median of the second differences is noise alone where lines are closer than resonances are wide.
    rough = np.abs(H[1:-1] - (H[:-2] + H[2:]) / 2) ** 2
    return max(float(np.sqrt(np.median(rough) / 1.5 / np.log(2))), _UNKNOWN * size)


def _cascade(poles: ComplexArray, z: ComplexArray, r: ComplexArray, direct: FloatArray) -> FloatArray:
    """Second-order sections of a sum r / (1 - z back) + conj + direct[0] + direct[1] back.

    Polynomials of this order lose all precision near z = 1; so the zeros are computed as the generalised
    eigenvalues of the state space with zero output.
    """
    blocks, inputs, outputs = [], [], []
    constant = float(direct[0])
    for p, zp, rp in zip(poles, z[: len(poles)], r, strict=True):
        # r / (1 - z back) = r + r z back / (1 - z back): the second term is one state with a delay.
        if p.imag > 0:
            blocks.append(np.array([[zp.real, zp.imag], [-zp.imag, zp.real]]))
            inputs += [2.0, 0.0]
            outputs += [(rp * zp).real, (rp * zp).imag]
            constant += 2 * rp.real
        else:
            blocks.append(np.array([[zp.real]]))
            inputs.append(1.0)
            outputs.append((rp * zp).real)
            constant += rp.real
    blocks.append(np.zeros((1, 1)))
    A, B = scipy.linalg.block_diag(*blocks), np.array([*inputs, 1.0])[:, None]
    C, D = np.array([*outputs, direct[1]])[None, :], np.array([[constant]])
    scale = np.linalg.norm(C)
    pencil = np.block([[A, B], [C / scale, D / scale]])
    zeros = scipy.linalg.eigvals(pencil, np.diag([1.0] * len(A) + [0.0]))
    zeros = zeros[np.isfinite(zeros) & (np.abs(zeros) < 1e6)]
    sections: FloatArray = scipy.signal.zpk2sos(zeros, np.append(z, 0.0), constant)  # type: ignore[arg-type]
    return sections


# Standard deviation of a fitted model.

_MISFIT_HZ = 2.5
"""Band over which the residual is averaged as a complex number: what stays is a misfit of the model."""
_POWER_HZ = 10.0
"""Band over which the powers of residual and misfit are averaged."""
_LEAST = 1e-12
"""Smallest eigenvalue of the scaled normal equations."""


def standard_deviation(calibration: Calibration, f: FloatArray) -> FloatArray:
    """(frequencies,) m/s per V: standard deviation of the model at `f` (Hz) within its band.

    It has three parts: what the response's deviation has in common between lines, which no fit
    averages; the model's residual where it is smooth, which is a misfit; and the residual's scatter, as far
    as it moves the model (delta method). A response without a deviation is exact but for the residual.
    """
    return _known(calibration, np.ascontiguousarray(f, dtype=np.float64).tobytes())


@lru_cache(maxsize=8)
def _known(calibration: Calibration, frequencies: bytes) -> FloatArray:
    """What `standard_deviation` returns: the drives of a calibration ask for the same frequencies."""
    f = np.frombuffer(frequencies)
    response, model = calibration.response, calibration.model
    lines = response.frequencies
    spacing = float(np.median(np.diff(lines)))
    near, wide = (max(1, round(hz / spacing)) for hz in (_MISFIT_HZ, _POWER_HZ))
    residual = response.velocity - model.velocity(lines)
    smooth = scipy.ndimage.uniform_filter1d(residual.real, near) + 1j * scipy.ndimage.uniform_filter1d(
        residual.imag, near
    )
    misfit, scatter = (
        scipy.ndimage.uniform_filter1d(np.abs(values) ** 2, wide, mode="nearest")
        for values in (smooth, residual)
    )
    common = np.zeros(len(lines))
    if len(response.deviation):
        own = response.scatter if len(response.scatter) else response.deviation
        common = np.maximum(response.deviation**2 - own**2, 0.0)
    variance = np.interp(f, lines, common + misfit) + _moved_by(model, lines, scatter, f)
    deviation = np.asarray(np.sqrt(variance))
    deviation.setflags(write=False)
    return deviation


def _moved_by(model: Model, lines: FloatArray, power: FloatArray, f: FloatArray) -> FloatArray:
    """Variance (frequencies,) of a model fitted to `lines` (Hz) with noise of `power` (lines,)."""
    columns = _derivatives(model, lines)
    J = np.concatenate([columns.real, columns.imag])
    norms = np.linalg.norm(J, axis=0)
    values, vectors = np.linalg.eigh((J / norms).T @ (J / norms))
    inner = (vectors / np.maximum(values, _LEAST)) @ (vectors.T @ (J / norms).T)
    covariance = (inner * np.concatenate([power, power])) @ inner.T / 2
    reach = _derivatives(model, f) / norms
    return np.asarray(np.maximum(((reach @ covariance) * reach.conj()).sum(axis=1).real, 0.0))


def _derivatives(model: Model, f: FloatArray) -> ComplexArray:
    """(frequencies, parameters): derivatives of the model by residues, poles, constant and slope."""
    s = 2j * np.pi * np.asarray(f)[:, None]
    paired = model.poles.imag > 0
    near, mirror = 1 / (s - model.poles), np.where(paired, 1 / (s - np.conj(model.poles)), 0)
    one, other = model.residues * near**2, np.conj(model.residues) * mirror**2
    every = [near + mirror, (one + other) * model.poles.real]
    pairs = [1j * (near - mirror), 1j * (one - other) * model.poles.imag]
    return np.concatenate([*every, *(part[:, paired] for part in pairs), np.ones_like(s), s], axis=1)
