"""Hysteresis of a piezo patch after Bouc and Wen: another law than the default plant's play operators.

dh/dv = 1 - (b sign(dv) + c sign(h)) h, linear volts = p v - q h (Low and Guo, "Modeling of a three-layer
piezoelectric bimorph beam with hysteresis", 1995). Each monotone section has a closed form, so that the
law is exact however the drive is cut into steps.
"""

from __future__ import annotations

import math

import numpy as np

from ...base.arrays import FloatArray
from .hysteresis import AMPLITUDE, sections

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
