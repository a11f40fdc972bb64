"""Faults of the amplifier, of the relay box and of the wiring behind it."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import field_validator

from ...base.arrays import FloatArray
from ...base.bounded import Positive
from ...instruments.config import RigFile
from ...nidaqmx_twin.nodes import Run
from ..plant import FaultSettings, OnAmplifier, OnRelay, PerEventFault, RelayFailure, TimedFault


class RelaySwapped(OnRelay):
    """The wires of two patches are swapped at the relay's output."""

    class Settings(FaultSettings):
        patches: tuple[str, str] = ("A", "B")

        @field_validator("patches")
        @classmethod
        def _two(cls, patches: tuple[str, str]) -> tuple[str, str]:
            if patches[0] == patches[1]:
                raise ValueError(f"name two different patches (found {patches[0]!r} twice)")
            return patches

    settings: Settings

    def contact(self, patch: str, at: float) -> str:
        one, other = self.settings.patches
        if patch not in (one, other):
            return patch
        self.mark(at)
        return other if patch == one else one


class _OfRelay(PerEventFault, OnRelay):
    class Settings(PerEventFault.Settings):
        patch: str = "A"

    settings: Settings
    how: ClassVar[RelayFailure]

    def relay(self, how: RelayFailure, patch: str, now: float) -> bool:
        return (how, patch) == (self.how, self.settings.patch) and self.fires(now)


class RelayLost(_OfRelay):
    """A command to a patch's channel never reaches the box."""

    how = "lost"


class RelayStuck(_OfRelay):
    """A channel does not switch, and reports the state that it really has."""

    how = "stuck"


class RelayWelded(_OfRelay):
    """A contact does not switch, but the box reports the commanded state."""

    how = "welded"


# Faults of the amplifier.


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
