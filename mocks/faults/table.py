"""Faults of the touch table and its patches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from haploop.instruments.arrays import FloatArray
from haploop.mocks.plant import Fault, FaultSettings, Plate

__all__ = ["PatchDead"]

_NOWHERE = (0.0, 0.0)
"""The pane's corner, where no mode has curvature: a patch placed there moves nothing."""


class PatchDead(Fault):
    """A cracked or detached patch: it takes its voltage but moves nothing."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        patch: str = "A"

    settings: Settings

    def plate(self, plate: Plate) -> Plate:
        """See `Fault.plate`."""
        return replace(plate, patches={**plate.patches, self.settings.patch: _NOWHERE})

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """See `Fault.patches`."""
        if volts[self.settings.patch].any():
            self.mark(start)
        return volts
