"""Drift test of a place: fits the active calibration's model to a new response.

Three parameters, a common shift of all resonances, a factor of their damping, and a gain, describe the
effect of temperature, age and amplifier on a table; a large residual means that the table, or the
place that the laser looks at, is not the calibrated one. The thresholds are the rig file's
(`haploop.instruments.config.rig_file.Recalibration`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from haploop.calibration.drive import BAND
from haploop.calibration.model import Calibration, Model
from haploop.calibration.response import Response
from haploop.instruments.arrays import ComplexArray, FloatArray
from haploop.instruments.config import Recalibration

__all__ = ["Kind", "PlaceMetrics", "Verdict", "compare"]

Kind = Literal["unchanged", "drifted", "broken"]

_MOST = 0.1
"""Relative shift beyond which a place counts as broken, not drifted."""
_FURTHEST = 0.12
"""Largest shift (logarithm) in the search."""
_GRID = 0.0025
"""Step of that search: a quarter of a resonance's half-width at 1 % damping."""
_STRANGE = 0.4
"""Residual beyond which table, point or patch differ from the calibrated ones: a neighbouring grid point
leaves 22 to 70 %, another patch 93 % (measured on the simulated table)."""
_FACTOR = 1.6
"""Gain factor beyond which a place counts as broken: a patch half off, another range, the laser elsewhere."""


@dataclass(frozen=True)
class PlaceMetrics:
    """Five metrics of one place, for the mode that is strongest in velocity."""

    resonance_hz: float
    damping: float
    """Ratio to critical."""
    gain: float
    """m/s^2 per V commanded, of the mode above its resonance, where its damping plays no part."""
    coherence: float
    """Median over the band of drives."""
    shape: float
    """Relative rms difference over the band from the fitted model."""

    @classmethod
    def of(cls, calibration: Calibration) -> PlaceMetrics:
        """Metrics of a calibration, against its own model."""
        f, measured = _in_band(calibration.response)
        model = calibration.model
        residual = measured - model.velocity(f)
        pole, residue = _main(model)
        return cls(
            resonance_hz=float(abs(pole) / (2 * np.pi)),
            damping=float(-pole.real / abs(pole)),
            gain=float(2 * abs(residue)) * _path(calibration.response),
            coherence=_coherence(calibration.response),
            shape=float(np.linalg.norm(residual) / np.linalg.norm(measured)),
        )


@dataclass(frozen=True)
class Verdict:
    """Result of the drift test of one place. `now` is None when nothing could be measured there."""

    patch: str
    point: str
    kind: Kind
    before: PlaceMetrics
    now: PlaceMetrics | None
    sentences: tuple[str, ...]
    """Findings; for a broken place, the fault and its location."""


def compare(active: Calibration, response: Response, thresholds: Recalibration | None = None) -> Verdict:
    """Compare a response of the same patch and point with the active calibration."""
    thresholds = thresholds or Recalibration()
    before = PlaceMetrics.of(active)
    place = f"patch {response.patch} at the {response.point} point"
    coherence = _coherence(response)
    f, measured = _in_band(response)
    (shift, damping, gain), residual = _overlay(active.model, f, measured)
    # The response is from the volts at the patch; a drive is commanded.
    gain += np.log(_path(response) / _path(active.response))
    now = PlaceMetrics(
        resonance_hz=before.resonance_hz * np.exp(shift),
        damping=before.damping * np.exp(damping),
        gain=before.gain * np.exp(gain),
        coherence=coherence,
        shape=residual,
    )

    def verdict(kind: Kind, *sentences: str) -> Verdict:
        return Verdict(response.patch, response.point, kind, before, now, sentences)

    if not coherence >= thresholds.coherence:
        return verdict(
            "broken",
            f"The {response.point} point does not follow patch {response.patch}: the coherence is "
            f"{coherence:.2f}, it was {before.coherence:.2f}, and {thresholds.coherence:g} is needed.",
        )
    if residual > _STRANGE:
        return verdict(
            "broken",
            f"The response of {place} is not the calibrated one (no drift explains {residual:.0%} of it): "
            "check that the laser still looks at the point, and the patch's glue and wires.",
        )
    if not 1 / _FACTOR < np.exp(gain) < _FACTOR:
        return verdict(
            "broken",
            f"The gain of {place} is {np.exp(gain):.2f} times what it was, which is no drift: check the "
            "patch, the vibrometer's range, and the laser's aim and focus.",
        )
    if abs(np.expm1(shift)) > _MOST:
        return verdict(
            "broken",
            f"The resonance of {place} moved by more than {_MOST:.0%}, which is no drift: inspect the table.",
        )
    changes = (
        ("resonance", np.expm1(shift), thresholds.resonance, 2),
        ("damping", np.expm1(damping), thresholds.damping, 0),
        ("gain", np.expm1(gain), thresholds.gain, 1),
    )
    told = [
        f"The {name} of {place} changed by {change:+.{digits}%}, and {limit:.{digits}%} is accepted."
        for name, change, limit, digits in changes
        if abs(change) > limit
    ]
    if residual > before.shape + thresholds.shape:
        told.append(
            f"The response of {place} differs by {residual:.0%} from the calibrated one in a way that "
            f"no common drift explains; it was {before.shape:.1%}, and "
            f"{thresholds.shape:.0%} more is accepted."
        )
    if told:
        return verdict("drifted", *told)
    return verdict(
        "unchanged",
        f"The resonance of {place} is at {now.resonance_hz:.2f} Hz ({np.expm1(shift):+.2%}).",
    )


def _overlay(model: Model, f: FloatArray, measured: ComplexArray) -> tuple[FloatArray, float]:
    """Logarithms of shift, damping factor and gain that best fit a model to a response, and the residual.

    The residual is relative: its rms over that of the measurement. A response of narrow resonances has
    many false minima over the shift, so that the shift is searched on a grid first.
    """
    size = float(np.linalg.norm(measured))

    def left(x: FloatArray) -> FloatArray:
        residual = (measured - np.exp(x[2]) * _moved(model, x[0], x[1]).velocity(f)) / size
        return np.concatenate([residual.real, residual.imag])

    best, start = np.inf, np.zeros(3)
    for shift in np.arange(-_FURTHEST, _FURTHEST + _GRID / 2, _GRID):
        there = _moved(model, shift, 0.0).velocity(f)
        gain = max(float(np.vdot(there, measured).real / np.vdot(there, there).real), 1e-3)
        residual = float(np.linalg.norm(measured - gain * there))
        if residual < best:
            best, start = residual, np.array([shift, 0.0, np.log(gain)])
    found = least_squares(left, start)
    return np.asarray(found.x), float(np.linalg.norm(found.fun))


def _moved(model: Model, shift: float, damping: float) -> Model:
    """The model with every pole's frequency and damping ratio multiplied (logarithms)."""
    poles = np.exp(shift) * (np.exp(damping) * model.poles.real + 1j * model.poles.imag)
    return replace(model, poles=poles)


def _in_band(response: Response) -> tuple[FloatArray, ComplexArray]:
    inside = (response.frequencies >= BAND[0]) & (response.frequencies <= BAND[1])
    return response.frequencies[inside], response.velocity[inside]


def _coherence(response: Response) -> float:
    inside = (response.frequencies >= BAND[0]) & (response.frequencies <= BAND[1])
    return float(np.median(response.coherence[inside]))


def _path(response: Response) -> float:
    """Volts at the patch per volt commanded."""
    return float(np.median(np.abs(response.path)))


def _main(model: Model) -> tuple[complex, complex]:
    """Pole and residue of the resonance that is strongest in velocity."""
    k = int(np.argmin(np.abs(np.abs(model.poles) / (2 * np.pi) - model.resonance_hz)))
    return complex(model.poles[k]), complex(model.residues[k])
