"""Faults of the amplifier."""

from __future__ import annotations

import numpy as np

from ...instruments.arrays import FloatArray
from ...instruments.bounded import Positive
from ..plant import FaultSettings, OnAmplifier, Run, TimedFault

__all__ = ["AmplifierGain", "AmplifierTrip"]


class AmplifierGain(OnAmplifier):
    """The amplifier's gain differs from the rig file's."""

    class Settings(FaultSettings):
        gain: Positive = 25.0
        """V per V."""

    settings: Settings

    def gain(self, gain: float, run: Run) -> float:
        if run.values.any():
            self.mark(run.start)
        return self.settings.gain


class AmplifierTrip(TimedFault, OnAmplifier):
    """The amplifier's protection trips: its output falls to zero."""

    def output(self, volts: FloatArray, times: FloatArray) -> FloatArray:
        # A trip at zero output has no effect, so it is not recorded as fired.
        return np.asarray(volts * ~self.active(times)) if volts.any() else volts
