"""Response and ringing of one play after its modes, what they leave, and how well they are known.

The modes are fitted to all lines together, so that a resonance narrower than a line's spacing and the ringing
of the start are told apart by what they have in common, which a local method cannot do. Poles and
residues are parameters of a least-squares problem, and the deviation follows from its Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from haploop.calibration.response.modes import Modes, Plays, columns_of, stack
from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = ["ModalEstimate", "modal_estimate", "nothing"]

_NEAR, _FAR = 5, 25
"""Lines over which the power of the residual is averaged: few, for hum, and many."""
_TONE = 0.1
"""Half-power width of a pole, over the lines' spacing, below which it is a tone from elsewhere, such as mains
hum: it rings, and has no part in the response."""
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
    spacing = float(f[1] - f[0])
    tones = -modes.poles.real / np.pi < _TONE * spacing
    poles = np.concatenate([modes.poles[~tones], modes.poles[tones]])
    n, own_n = len(poles), int((~tones).sum())
    response, ringing = columns_of(poles[:own_n], f)[0], columns_of(poles, f)[1]
    volts = (modes.weights[0] @ plays.operators[0])[:, None]
    linear = np.concatenate([volts * response, ringing], axis=1)
    found, rest = _solved(stack(linear), stack(plays.velocity[:, :1])[:, 0])
    left = rest[: len(f)] + 1j * rest[len(f) :]
    own, ring = found[: response.shape[1]], found[response.shape[1] :]
    H = response @ own
    apart = np.zeros((len(f), 2, n), dtype=np.complex128)
    apart[:, :, :own_n] = _moved(poles[:own_n], own[: 2 * own_n], f)
    moved, rung = apart.reshape(len(f), -1), _moved(poles, ring[: 2 * n], f).reshape(len(f), -1)
    # A weight at its bound of zero is no free parameter.
    free = np.flatnonzero(modes.weights[0, 1:]) + 1
    J = stack(np.concatenate([linear, volts * moved + rung, (plays.operators[0, free] * H).T], axis=1))
    change = [gain * response, np.zeros(ringing.shape), gain * moved, H[:, None] * gains[free]]
    power = np.abs(left) ** 2 * len(f) / max(len(f) - J.shape[1] / 2, 1)
    power = np.maximum(*(uniform_filter1d(power, size, mode="nearest") for size in (_NEAR, _FAR)))
    norms = np.linalg.norm(J, axis=0)
    values, vectors = np.linalg.eigh((J / norms).T @ (J / norms))
    inner = (vectors / np.maximum(values, _UNSEEN)) @ (vectors.T @ (J / norms).T)
    reach = (np.concatenate(change, axis=1) / norms) @ inner
    variance = (np.abs(reach) ** 2) @ np.concatenate([power, power]) / 2
    return ModalEstimate(H * gain, variance, left)


def _solved(columns: FloatArray, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares of the least norm: the unknowns, and the residual."""
    norms = np.linalg.norm(columns, axis=0)
    found = np.linalg.lstsq(columns / norms, measured, rcond=_UNSEEN)[0] / norms
    return found, measured - columns @ found


def _moved(poles: ComplexArray, shares: FloatArray, f: FloatArray) -> ComplexArray:
    """Derivatives (lines, 2, poles) of the modes' sum by the logarithms of decays and of frequencies."""
    s, n = 2j * np.pi * f[:, None], len(poles)
    r = shares[:n] + 1j * shares[n:]
    one, other = r / (s - poles) ** 2, np.conj(r) / (s - np.conj(poles)) ** 2
    return np.stack([(one + other) * poles.real, 1j * (one - other) * poles.imag], axis=1)
