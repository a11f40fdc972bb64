"""Faults of the amplifier."""

from __future__ import annotations

import numpy as np

from ...base.arrays import FloatArray
from ...base.bounded import Positive
from ...instruments.config import RigFile
from ...nidaqmx_twin.nodes import Run
from ..plant import FaultSettings, OnAmplifier, TimedFault


class AmplifierGain(OnAmplifier):
    """The amplifier's gain differs from the rig file's."""

    class Settings(FaultSettings):
        gain: Positive = 25.0
        """V per V."""
        patch: str | None = None
        """The patch whose channel it is; None for every one."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        inputs = file.amplifier.settings.get("input") if file.amplifier else None
        self._node = inputs.get(settings.patch) if isinstance(inputs, dict) else None

    def gain(self, gain: float, run: Run) -> float:
        if self._node not in (None, run.node):
            return gain
        if run.values.any():
            self.mark(run.start)
        return self.settings.gain


class AmplifierTrip(TimedFault, OnAmplifier):
    """The amplifier's protection trips: its output falls to zero."""

    def output(self, volts: FloatArray, times: FloatArray) -> FloatArray:
        # A trip at zero output has no effect, so it is not recorded as fired.
        return np.asarray(volts * ~self.active(times)) if volts.any() else volts
