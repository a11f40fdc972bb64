"""Hysteresis of a piezo patch: a Prandtl-Ishlinskii sum of play operators.

The model is rate-independent, remembers its turning points and closes minor loops, as piezo ceramics do
(Kuhnen, "Modeling, identification and compensation of complex hysteretic nonlinearities", 2003).
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import BoolArray, FloatArray

_RADII = np.array([2.0, 5.0, 10.0, 16.0, 24.0, 34.0])
"""Half-widths of the play operators (V; estimate)."""
_ASYMMETRY = 0.01
"""Fraction by which a patch expands more at +50 V and less at -50 V than by a symmetric law (estimate).
It makes the plant differ from the law that an estimator may assume."""
AMPLITUDE = 50.0
"""Amplitude (V) at which the loop has the specified width and the gain is one: the paper's 100 Vpp."""


class PatchLaw(Protocol):
    """Law of one patch, from its voltage to the linear volts that drive the surface; it keeps its state."""

    def follow(self, volts: FloatArray) -> FloatArray:
        """Convert the next volts (steps,) to linear volts (steps,), as which a patch without a law acts."""


class Hysteresis:
    """Hysteresis state of one patch. `width` is the loop's opening over its height at 100 Vpp."""

    def __init__(self, width: float) -> None:
        weights = np.ones(len(_RADII))
        # A play operator of radius r, driven over +-A, reaches +-(A - r) and is off by r at zero input.
        # Height and opening of the loop are sums over the operators, which gives the operators' share.
        opening = 2 * (weights * np.minimum(_RADII, AMPLITUDE - _RADII)).sum()
        share = width * 2 * AMPLITUDE / opening
        self._weights = share * weights
        self._linear = float(1 - (self._weights * (1 - _RADII / AMPLITUDE)).sum())
        self._play = np.zeros(len(_RADII))
        self._last = 0.0

    def follow(self, volts: FloatArray) -> FloatArray:
        """Convert volts (steps,) to linear volts (steps,), and keep the final state.

        Linear volts would produce the same motion without hysteresis.
        """
        if not self._weights.any():
            return volts
        if np.all(volts == self._last):
            return np.full(len(volts), _bent(self._linear * self._last + self._weights @ self._play))
        _, ends, _, lengths = sections(self._last, volts)
        turns, begins = ends.tolist(), np.empty((len(_RADII), len(ends)))
        for i, radius in enumerate(_RADII.tolist()):
            at, begin = float(self._play[i]), []
            for end in turns:
                begin.append(at)
                if at < end - radius:
                    at = end - radius
                elif at > end + radius:
                    at = end + radius
            begins[i], self._play[i] = begin, at
        # A play stays where the section found it, until the volts are its radius away.
        behind = np.repeat(begins, lengths, axis=1)
        behind -= volts
        np.maximum(behind, -_RADII[:, None], out=behind)
        np.minimum(behind, _RADII[:, None], out=behind)
        self._last = float(volts[-1])
        return np.asarray(_bent((self._linear + self._weights.sum()) * volts + self._weights @ behind))


def sections(last: float, volts: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray, NDArray[np.intp]]:
    """Cut volts (steps,), which come after `last` (V) and are not all equal to it, at the turning points.

    Return the volts at which each section begins and ends, True where it rises, and its number of steps.
    """
    path = np.concatenate([[last], volts])
    slope = np.sign(np.diff(path))
    # A flat segment belongs to the segment before it, so that only turning points end a segment.
    moving = np.flatnonzero(slope)
    turns = moving[np.flatnonzero(np.diff(slope[moving])) + 1]
    starts = np.concatenate([[0], turns])
    rising = slope[np.concatenate([[moving[0]], turns])] > 0
    ends = path[np.concatenate([turns, [len(path) - 1]])]
    return path[starts], ends, rising, np.diff(np.concatenate([starts, [len(volts)]]))


def _bent(linear_volts: Any) -> Any:
    return linear_volts * (1 + _ASYMMETRY / AMPLITUDE * linear_volts)
