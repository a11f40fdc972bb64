"""Settings of one channel of a simulated function generator."""

from __future__ import annotations

import math

from ...base.arrays import FloatArray
from .waveform import Points

_SOURCE = 50.0
"""Output impedance (ohm)."""
HIGHEST = 20.0
"""Largest amplitude without load (V peak to peak): half of it at 50 ohm."""


class Channel:
    """Settings of one channel; a reset fills them in."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}
        self.words: dict[str, str] = {}
        self.points: dict[str, Points] = {}
        self.arb = ""
        self.arriving: list[FloatArray] = []
        """Points of which more are to come."""
        self.peak_to_peak = 0.0
        """Amplitude without load (V peak to peak)."""
        self.offset = 0.0
        self.load = 50.0
        self.low, self.high = -HIGHEST / 2, HIGHEST / 2
        """Voltage limits, without load."""
        self.armed = 0
        """Triggers that it takes before it is idle, where it is not armed for ever."""

    @property
    def is_direct(self) -> bool:
        """True for direct voltage: the offset alone, whose range the amplitude does not reduce."""
        return self.words["[:SOURce#]:FUNCtion[:SHAPe]"] == "DC"

    @property
    def share(self) -> float:
        """Ratio of the voltage at the load that is set to the open-circuit voltage."""
        return 1.0 if math.isinf(self.load) else self.load / (self.load + _SOURCE)
