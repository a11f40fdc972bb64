"""The local rational method: estimates a response from one period of a multisine from rest.

Model: within a few lines (r from -1 to 1) the output is Y = (B(r) U + T(r)) / D(r). The response B / D is
nearly a ratio of two polynomials of low order, and the transient T of the start has the same denominator.
With D(0) = 1 this is linear in eight coefficients, D Y = B U + T, and least squares fit them to the 21
lines about each line (McKelvey and Guerin, Proc. IFAC SYSID, 2012; Pintelon and Schoukens, System
Identification, 2012, section 7.2). So no settling is needed: 2.05 s suffice, where a plain ratio would have
an error of 5 to 19 %.

Assumptions: the table is linear and does not change within the period; a window holds one resonance and the
slope of its neighbours; the drive is known without noise, and strong on some lines of each window; the
noise of the output is alike on the lines of a window and independent from one to another. What breaks them:
two resonances within a window; a distortion or a tone of the mains, which least squares follow (`surprise`
shows it on unexcited lines); much noise, because the error of the equation is minimised, and that is the
output's times D: the estimate is then biased.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from ...base.arrays import ComplexArray, FloatArray, IntArray

_HALF = 10
"""Lines on either side: fewer average less noise, more bias the response within 5 Hz."""
_ORDER = 2
"""Order of all three polynomials: one resonance, and the slope from its neighbours."""
_AT_ONCE = 1000
"""Lines that are fitted at once: each takes 10 kB."""


@dataclass(frozen=True, eq=False)
class Local:
    """Local fit at each line (lines,): response, its variance `spread`, `variance`, and `surprise`.

    `variance` is that of the output about the local fit. `surprise` is the measured output less the
    prediction from the neighbouring lines: on an unexcited line, noise and distortion.
    """

    response: ComplexArray
    spread: FloatArray
    variance: FloatArray
    surprise: ComplexArray


def local_rational(drive: ComplexArray, output: ComplexArray, lines: IntArray) -> Local:
    """Estimate the response from `drive` to `output` (spectra of all lines from 0 Hz on) at `lines`.

    The drive must be strong on some of the lines around each.
    """
    half = int(min(_HALF, lines[0], len(drive) - 1 - lines[-1]))
    some = [lines[first : first + _AT_ONCE] for first in range(0, len(lines), _AT_ONCE)]
    fitted = [_fit(drive, output, one, half) for one in some]
    response, spread, variance, surprise = map(np.concatenate, zip(*fitted, strict=True))
    # Thirteen degrees of freedom estimate a variance within 28 %: the neighbours' are averaged in.
    variance = scipy.ndimage.uniform_filter1d(variance, 2 * half + 1, mode="nearest")
    return Local(response=response, spread=variance * spread, variance=variance, surprise=surprise)


def _fit(
    drive: ComplexArray, output: ComplexArray, lines: IntArray, half: int
) -> tuple[ComplexArray, FloatArray, FloatArray, ComplexArray]:
    """Response, its variance over that of the output, the output's, and the surprise: each (lines,)."""
    r = np.arange(-half, half + 1) / half
    u = sliding_window_view(drive, 2 * half + 1)[lines - half]
    y = sliding_window_view(output, 2 * half + 1)[lines - half]
    powers = r[:, None] ** np.arange(_ORDER + 1)
    columns = np.concatenate(
        [
            u[:, :, None] * powers,
            np.broadcast_to(powers, (len(lines), *powers.shape)),
            -y[:, :, None] * powers[:, 1:],
        ],
        axis=2,
    )
    norms = np.linalg.norm(columns, axis=1, keepdims=True)
    columns = columns / np.where(norms > 0, norms, 1.0)
    q, upper = np.linalg.qr(columns)
    seen = np.einsum("lij,li->lj", q.conj(), y)
    left = y - np.einsum("lij,lj->li", q, seen)
    # A tiny ridge prevents division by zero in rank-deficient windows, such as of noise-free data.
    size = np.abs(np.diagonal(upper, axis1=1, axis2=2)).max(axis=1)
    eye = np.eye(upper.shape[1])
    inverse = np.linalg.inv(upper + 1e-13 * size[:, None, None] * eye)
    solution = np.einsum("lij,lj->li", inverse, seen)
    variance = (np.abs(left) ** 2).sum(axis=1) / (2 * half + 1 - columns.shape[2])
    covariance = (np.abs(inverse[:, 0, :]) ** 2).sum(axis=1)
    weight = (np.abs(q[:, half, :]) ** 2).sum(axis=1)
    return (
        solution[:, 0] / norms[:, 0, 0],
        covariance / norms[:, 0, 0] ** 2,
        variance,
        left[:, half] / np.maximum(1 - weight, 0.05),
    )
