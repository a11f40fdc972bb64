"""Hysteresis of a piezo patch: a Prandtl-Ishlinskii sum of play operators, or after Bouc and Wen.

The model is rate-independent, remembers its turning points and closes minor loops, as piezo ceramics do
(Kuhnen, "Modeling, identification and compensation of complex hysteretic nonlinearities", 2003).
"""

from __future__ import annotations

import math
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


# Hysteresis of a piezo patch after Bouc and Wen: another law than the default plant's play operators.
#
# dh/dv = 1 - (b sign(dv) + c sign(h)) h, linear volts = p v - q h (Low and Guo, "Modeling of a three-layer
# piezoelectric bimorph beam with hysteresis", 1995). Each monotone section has a closed form, so that the
# law is exact however the drive is cut into steps.

_TOWARDS, _AWAY = 1 / 40.0, 1 / 16.0
"""Rates b - c (1/V), at which h falls to zero, and b + c, at which it saturates (estimates): they make a loop
that is pointed at its ends, unlike that of the play operators."""


class BoucWen:
    """State of one patch; see the module. `width` is the loop's opening over its height at 100 Vpp."""

    def __init__(self, width: float) -> None:
        # Height and opening of the settled loop at the nominal amplitude give both factors.
        top = 0.0
        for _ in range(60):
            top = _after(-top, 2 * AMPLITUDE)
        opening = 2 * _after(-top, AMPLITUDE)
        self._share = 2 * AMPLITUDE * width / opening
        self._linear = 1 + self._share * top / AMPLITUDE
        self._h = 0.0
        self._last = 0.0

    def follow(self, volts: FloatArray) -> FloatArray:
        """See `PatchLaw.follow`."""
        if np.all(volts == self._last):
            return np.asarray(self._linear * volts - self._share * self._h)
        begins, ends, rising, lengths = sections(self._last, volts)
        states = np.empty(len(ends))
        state = self._h
        for k, (begin, end, rises) in enumerate(
            zip(begins.tolist(), ends.tolist(), rising.tolist(), strict=True)
        ):
            states[k] = state
            way = 1.0 if rises else -1.0
            state = way * _after(way * state, way * (end - begin))
        sign = np.repeat(np.where(rising, 1.0, -1.0), lengths)
        start = sign * np.repeat(states, lengths)
        moved = sign * (volts - np.repeat(begins, lengths))
        # Towards zero first, if h lags behind on the other side; then on, away from zero.
        below = np.minimum(start, 0.0)
        to_zero = np.log1p(-below * _TOWARDS) / _TOWARDS
        before = 1 / _TOWARDS + (below - 1 / _TOWARDS) * np.exp(-_TOWARDS * np.minimum(moved, to_zero))
        from_zero = np.maximum(start, 0.0)
        after = 1 / _AWAY + (from_zero - 1 / _AWAY) * np.exp(-_AWAY * np.maximum(moved - to_zero, 0.0))
        h = sign * np.where(moved < to_zero, before, after)
        self._h, self._last = state, float(volts[-1])
        return np.asarray(self._linear * volts - self._share * h)


def _after(state: float, moved: float) -> float:
    """Return h after a rise of the voltage by `moved` (V) from `state`."""
    if state < 0:
        to_zero = math.log1p(-state * _TOWARDS) / _TOWARDS
        if moved < to_zero:
            return 1 / _TOWARDS + (state - 1 / _TOWARDS) * math.exp(-_TOWARDS * moved)
        state, moved = 0.0, moved - to_zero
    return 1 / _AWAY + (state - 1 / _AWAY) * math.exp(-_AWAY * moved)
