"""Restore what an AC-coupled sensor hides: the constant part of a force that a charge amplifier lets fade.

A high-pass of first order is undone by y = x + (w1 - w2) * I, where I is x integrated with the leak w2: the
corner moves from w1 down to w2. With w2 = 0 the sum would drift for ever with the offset of x; with w2 an
offset is enlarged by w1 / w2, slowly, as a drift of the rest, which is tracked between presses.
"""

from __future__ import annotations

import numpy as np

from ...base.arrays import FloatArray
from .sensor import LinearSensor

_LOWEST_HZ = 0.005
"""Corner that remains: a press of half a second fades by 2 %."""
_CHUNK = 4096


class Restorer:
    """Undoes the high-pass corners of a sensor's signal, block by block; leaves a DC-coupled one as it is."""

    def __init__(self, sensor: LinearSensor, rate_hz: float) -> None:
        corners = [hz for hz in sensor.transfer.high_pass_hz if hz > _LOWEST_HZ]
        self._stages = [_Stage(hz, rate_hz) for hz in corners]

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Restore the next (samples,) of the signal, which is 0 at rest."""
        for stage in self._stages:
            signal = stage(signal)
        return signal


class _Stage:
    def __init__(self, corner_hz: float, rate_hz: float) -> None:
        leak = np.pi * _LOWEST_HZ / rate_hz
        self._keep = (1 - leak) / (1 + leak)
        self._add = 0.5 / rate_hz / (1 + leak)
        self._gain = 2 * np.pi * (corner_hz - _LOWEST_HZ)
        self._held = self._last = 0.0

    def __call__(self, signal: FloatArray) -> FloatArray:
        restored = np.empty(len(signal))
        for at in range(0, len(signal), _CHUNK):
            part = signal[at : at + _CHUNK]
            pairs = part + np.concatenate([[self._last], part[:-1]])
            # The recursion held = keep * held + add * pair, solved for all samples at once.
            powers = self._keep ** np.arange(1, len(part) + 1)
            held = powers * (self._held + self._add * np.cumsum(pairs / powers))
            restored[at : at + len(part)] = part + self._gain * held
            self._held, self._last = float(held[-1]), float(part[-1])
        return restored
