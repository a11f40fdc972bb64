"""Faults of the touch table and its patches."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.mocks.plant import Fault, FaultSettings, PatchLaw

__all__ = ["PatchDead"]


class _Dead:
    def follow(self, volts: FloatArray) -> FloatArray:
        return np.zeros(len(volts))


class PatchDead(Fault):
    """A cracked or detached patch: it takes its voltage but moves nothing."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        patch: str = "A"

    settings: Settings

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        """See `Fault.law`."""
        return _Dead() if patch == self.settings.patch else law

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """See `Fault.patches`."""
        if volts[self.settings.patch].any():
            self.mark(start)
        return volts
