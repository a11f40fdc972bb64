"""Standard deviation of a fitted model."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray

if TYPE_CHECKING:
    from .calibration import Calibration
    from .model import Model

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
