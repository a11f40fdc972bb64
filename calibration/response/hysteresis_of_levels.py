"""The hysteresis that makes a response depend on the level at which it was measured."""

from __future__ import annotations

import numpy as np
import scipy

from .hysteresis import Hysteresis, first_harmonic
from .response import Response

_SHARES = np.array([0.0, 0.02, 0.03, 0.04, 0.055, 0.075, 0.1, 0.14, 0.2, 0.28, 0.39, 0.54, 0.75])
"""Half-widths of the operators fitted to sweeps, over the largest level; 0 is the part without hysteresis."""
_TRUST = 1e-3
_RIDGE = 1e-4
"""Regularisation of weights that the levels do not determine."""


def fit_hysteresis(response: Response) -> Hysteresis:
    """Fit the hysteresis to the measured differences of the response between levels.

    Without further levels it is the law that the response was computed with. Non-negative least squares in
    the weights keeps the loop invertible.
    """
    if not len(response.levels):
        return response.hysteresis
    full = response.level
    radii = _SHARES * full
    at_full = first_harmonic(radii, full)
    rows = [at_full.real, *(_RIDGE * np.eye(len(radii))[1:])]
    for level, ratio in zip(response.levels, response.level_gain, strict=True):
        equation = first_harmonic(radii, float(level)) - ratio * at_full
        # Each level is weighted by its uncertainty, taken as a thousandth at least.
        trust = _TRUST / np.hypot(_TRUST, _uncertainty(response, float(level)))
        rows += [trust * equation.real, trust * equation.imag]
    weights, _ = scipy.optimize.nnls(np.array(rows), np.array([1.0] + [0.0] * (len(rows) - 1)))
    weights[0] = max(weights[0], 0.1)
    found = Hysteresis(radii, np.asarray(weights), full)
    return Hysteresis(radii, weights / abs(found.gain(full)), full)


def _uncertainty(response: Response, level: float) -> float:
    """Standard deviation of the relative gain that one sweep at `level` gave."""
    single = response.deviation * np.sqrt(response.repeats) * response.level / level
    return float(np.linalg.norm(np.abs(response.velocity) * single) / np.linalg.norm(response.velocity) ** 2)
