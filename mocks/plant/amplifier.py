"""Amplifier of a simulated rig: its gain, its rails, and the input that drives each patch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...instruments.arrays import FloatArray
from ...instruments.config import RigFile
from .nodes import Run
from .places import OnAmplifier

__all__ = ["AMPLIFIER_GAIN_ERROR", "Amplifier"]

AMPLIFIER_GAIN, AMPLIFIER_GAIN_ERROR = 50.0, 0.01
"""Gain (V per V) and its relative tolerance (docs/hardware.md, "Amplifier")."""
AMPLIFIER_LOW, AMPLIFIER_HIGH = -100.0, 400.0
"""Rails of the output (V; docs/hardware.md, "Amplifier")."""


class Amplifier:
    """The amplifier of a rig. `inputs` maps each patch to the node that drives it."""

    def __init__(self, file: RigFile, patches: Sequence[str], rng: np.random.Generator) -> None:
        self._tolerance = 1 + AMPLIFIER_GAIN_ERROR * rng.uniform(-1, 1)
        named = file.amplifier.settings.get("input") if file.amplifier else None
        if isinstance(named, dict):
            self.inputs = {str(patch): str(node) for patch, node in named.items()}
        else:
            self.inputs = dict.fromkeys(patches, str(named)) if named else {}

    def output(self, run: Run, faults: Sequence[OnAmplifier]) -> FloatArray:
        """Return the output (steps,) V for a run of an input."""
        gain = AMPLIFIER_GAIN
        for fault in faults:
            gain = fault.gain(gain, run)
        volts = np.clip(run.values * (gain * self._tolerance), AMPLIFIER_LOW, AMPLIFIER_HIGH)
        for fault in faults:
            volts = fault.output(volts, run.times)
        return np.asarray(volts)
