"""Amplifier of a simulated rig: its gain, its rails, and the input that drives each patch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.arrays import FloatArray
from ...instruments.config import RigFile
from ..nodes import Run
from .places import OnAmplifier

AMPLIFIER_GAIN, AMPLIFIER_GAIN_ERROR = 50.0, 0.01
"""Gain of an E-413.D2 (V per V) and its relative tolerance (docs/hardware.md, "Amplifier")."""
AMPLIFIER_LOW, AMPLIFIER_HIGH = -100.0, 400.0
"""Rails of its output (V; docs/hardware.md, "Amplifier")."""
_DESCRIBED = "analog-amplifier"
"""Driver of an amplifier whose figures are the rig file's; of any other they are those of the E-413.D2."""


class Amplifier:
    """The amplifier of a rig. `inputs` maps each patch to the node that drives it."""

    def __init__(self, file: RigFile, patches: Sequence[str], rng: np.random.Generator) -> None:
        self._tolerance = 1 + AMPLIFIER_GAIN_ERROR * rng.uniform(-1, 1)
        told = file.amplifier.settings if file.amplifier else {}
        described = file.amplifier is not None and file.amplifier.driver == _DESCRIBED
        gain = float(told["gain"]) if described else AMPLIFIER_GAIN
        self._gain = -gain if described and told.get("inverting") else gain
        self._low = float(told["min"]) if described else AMPLIFIER_LOW
        self._high = float(told["max"]) if described else AMPLIFIER_HIGH
        named = told.get("input")
        if isinstance(named, dict):
            self.inputs = {str(patch): str(node) for patch, node in named.items()}
        else:
            self.inputs = dict.fromkeys(patches, str(named)) if named else {}

    def output(self, run: Run, faults: Sequence[OnAmplifier]) -> FloatArray:
        """Return the output (steps,) V for a run of an input."""
        gain = self._gain
        for fault in faults:
            gain = fault.gain(gain, run)
        volts = np.clip(run.values * (gain * self._tolerance), self._low, self._high)
        for fault in faults:
            volts = fault.output(volts, run.times)
        return np.asarray(volts)
