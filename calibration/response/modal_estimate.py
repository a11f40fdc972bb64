"""Response and ringing of one play after its modes, what they leave, and how well they are known.

The modes are fitted to all lines together, so that a resonance narrower than a line's spacing and the ringing
of the start are told apart by what they have in common, which a local method cannot do. Poles and
residues are parameters of a least-squares problem, and the deviation follows from its Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from .modes import Modes, Plays
from .terms import moved, rows, terms_of

_NEAR, _FAR = 5, 25
"""Lines over which the power of the residual is averaged: few, for hum, and many."""
_UNSEEN = 1e-11
"""Smallest eigenvalue of the scaled normal equations: below it, rounding errors determine a parameter."""


@dataclass(frozen=True, eq=False)
class ModalEstimate:
    """Fields are (lines,): response and its variance, and velocity that is not explained, `left`."""

    response: ComplexArray
    variance: FloatArray
    left: ComplexArray


def nothing(plays: Plays) -> ModalEstimate:
    """The estimate without modes, which leaves everything."""
    lines = len(plays.f)
    return ModalEstimate(np.zeros(lines, dtype=np.complex128), np.zeros(lines), plays.velocity[:, 0])


def modal_estimate(modes: Modes, plays: Plays, gain: complex, gains: ComplexArray) -> ModalEstimate:
    """Solve for one patch's response at the first point of `plays`, from the modes fitted to it.

    The response is multiplied by `gain`, that of the patch's law; `gains` (operators,) are its derivatives by
    the law's weights. The variance takes the residual's power as it is around each line (White,
    Econometrica 48, 1980), not as the same everywhere.
    """
    f = plays.f
    tones = modes.tones(f)
    poles = np.concatenate([modes.poles[~tones], modes.poles[tones]])
    n, own_n = len(poles), int((~tones).sum())
    response, ringing = terms_of(poles[:own_n], f)[0], terms_of(poles, f)[1]
    volts, alone = modes.weights[0] @ plays.operators[0], np.ones((1, len(f)), dtype=np.complex128)
    linear = np.concatenate([volts * response, ringing])
    found, left = _solved(rows(linear), plays.velocity[:, 0])
    own, ring = found[: len(response)], found[len(response) :]
    H = (own @ rows(response)).view(np.complex128)
    apart = np.zeros((2, n, len(f)), dtype=np.complex128)
    apart[:, :own_n] = moved(poles[:own_n], own[None, : 2 * own_n], alone, f)
    own_moved = apart.reshape(-1, len(f))
    rung = moved(poles, ring[None, : 2 * n], alone, f).reshape(-1, len(f))
    # A weight at its bound of zero is no free parameter.
    free = np.flatnonzero(modes.weights[0, 1:]) + 1
    J = rows(np.concatenate([linear, volts * own_moved + rung, plays.operators[0, free] * H]))
    change = rows(
        np.concatenate([gain * response, np.zeros_like(ringing), gain * own_moved, gains[free, None] * H])
    )
    power = np.abs(left) ** 2 * len(f) / max(len(f) - len(J) / 2, 1)
    power = np.maximum(
        *(scipy.ndimage.uniform_filter1d(power, size, mode="nearest") for size in (_NEAR, _FAR))
    )
    norms = np.linalg.norm(J, axis=1)[:, None]
    values, vectors = np.linalg.eigh((J @ J.T) / (norms * norms.T))
    # Along the eigenvectors, where what is hardly seen stays apart from what is seen well.
    inner = (vectors.T @ (J / norms)) / np.maximum(values, _UNSEEN)[:, None]
    reach = vectors.T @ (change / norms)
    spread = ((inner * np.repeat(power, 2)) @ inner.T @ reach * reach).sum(axis=0).reshape(-1, 2).sum(axis=1)
    return ModalEstimate(H * gain, np.maximum(spread, 0) / 2, left)


def _solved(columns: FloatArray, measured: ComplexArray) -> tuple[FloatArray, ComplexArray]:
    """Least squares of the least norm: the unknowns, and the residual (lines,)."""
    norms = np.linalg.norm(columns, axis=1)
    found = np.linalg.lstsq((columns / norms[:, None]).T, rows(measured), rcond=_UNSEEN)[0] / norms
    return found, measured - (found @ columns).view(np.complex128)
