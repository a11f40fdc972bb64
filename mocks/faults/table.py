"""Faults of the touch table and its patches, and changes of a surface since it was calibrated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...instruments.arrays import FloatArray
from ...instruments.bounded import NotNegative, Positive
from ...instruments.config import RigFile
from ..plant import BoucWen, Fault, FaultSettings, Hysteresis, Modes, OnSurface, PatchLaw, ScheduledFault

__all__ = ["FrequencyDrift", "ModeDrift", "PatchDead", "PatchHysteresis"]

Share = Annotated[float, Field(gt=-0.9, lt=9, allow_inf_nan=False)]


class _Dead:
    def follow(self, volts: FloatArray) -> FloatArray:
        return np.zeros(len(volts))


class PatchDead(OnSurface):
    """A cracked or detached patch: it takes its voltage but moves nothing."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        patch: str = "A"

    settings: Settings

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        """See `OnSurface.law`."""
        return _Dead() if patch == self.settings.patch else law

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """See `OnSurface.patches`."""
        if volts[self.settings.patch].any():
            self.mark(start)
        return volts


class ModeDrift(OnSurface):
    """The modes of the surface have moved, each by its own amount, as boundaries, weights and glue change."""

    class Settings(FaultSettings):
        """See `FaultSettings`. All changes are relative."""

        frequency: Share = 0.0
        """Change of the frequencies."""
        frequency_each: NotNegative = 0.0
        """Standard deviation of a further change of each mode's frequency of its own."""
        damping: Share = 0.0
        """Change of the damping ratios."""
        damping_each: NotNegative = 0.0
        """Standard deviation of a further change of each mode's damping of its own, as a logarithm."""
        near: Positive | None = None
        """Frequency (Hz) of which only the nearest mode changes; None for all modes."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._drawn = rng.integers(2**63)

    def modes(self, modes: Modes, time: float) -> Modes:
        """See `OnSurface.modes`."""
        s, count = self.settings, len(modes.natural_hz)
        moved = np.ones(count)
        if s.near is not None:
            moved = np.zeros(count)
            moved[np.abs(modes.natural_hz - s.near).argmin()] = 1.0
        each = np.random.default_rng(self._drawn).standard_normal((2, count))
        frequency = (1 + s.frequency) * np.maximum(1 + s.frequency_each * each[0], 0.1)
        damping = (1 + s.damping) * np.exp(s.damping_each * each[1])
        return replace(
            modes,
            natural_hz=modes.natural_hz * np.where(moved, frequency, 1.0),
            damping=np.minimum(modes.damping * np.where(moved, damping, 1.0), 0.9),
        )

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """See `OnSurface.patches`."""
        return _noted(self, volts, start)


class FrequencyDrift(ScheduledFault, OnSurface):
    """The frequencies of all modes drift while measurements run, as in a room that warms."""

    class Settings(ScheduledFault.Settings):
        """See `FaultSettings`."""

        rate: Annotated[float, Field(ge=-0.1, le=0.1)] = 1e-5
        """Relative change per second."""
        limit: Annotated[float, Field(gt=0, le=0.3)] = 0.02
        """Largest relative change, at which the drift ends."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        # So that a step is at most a hundred-thousandth, if that is not too often.
        self.every = max(1e-5 / max(abs(settings.rate), 1e-9), 0.05)

    def modes(self, modes: Modes, time: float) -> Modes:
        """See `OnSurface.modes`."""
        shift = self.settings.rate * max(time - self.begin, 0.0)
        limit = self.settings.limit
        return replace(modes, natural_hz=modes.natural_hz * (1 + min(max(shift, -limit), limit)))

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """See `OnSurface.patches`."""
        return _noted(self, volts, start) if start >= self.begin else volts


class PatchHysteresis(OnSurface):
    """Patches follow another law than the rig file's `hysteresis`."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        law: Literal["play", "bouc-wen"] = "bouc-wen"
        """play: the default law, a sum of play operators. bouc-wen: see `haploop.mocks.plant.BoucWen`."""
        width: Annotated[float, Field(ge=0, le=0.5)] = 0.12
        """Width of the loop over its height at 100 Vpp."""
        patches: tuple[str, ...] | None = None
        """Names of the patches; None for all."""

    settings: Settings

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        """See `OnSurface.law`."""
        s = self.settings
        if s.patches is not None and patch not in s.patches:
            return law
        return BoucWen(s.width) if s.law == "bouc-wen" else Hysteresis(s.width)

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """See `OnSurface.patches`."""
        return _noted(self, volts, start)


def _noted(fault: Fault, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
    """Record the first drive, which is the first effect of a fault of the surface."""
    if not fault.at and any(v.any() for v in volts.values()):
        fault.mark(start)
    return volts
