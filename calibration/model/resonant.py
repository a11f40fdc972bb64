"""Pole pairs that are resonances, and the uncertainty of their decay."""

from __future__ import annotations

import numpy as np
import scipy

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ..response import Response
from .projection import Projection

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
