"""Faults of the DAQ's cards and of the cable between them."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...instruments.arrays import FloatArray
from ...instruments.config import RigFile
from ..plant import OnCards, PerEventFault, PlayStopped, SamplesLost, ScheduledFault

__all__ = ["ClockDrift", "DaqOverflow", "DaqOverrun", "PlayCutOff", "RtsiMissing"]


class RtsiMissing(OnCards):
    """The RTSI cable between the cards is missing."""

    def rtsi(self, now: float) -> bool:
        """See `OnCards.rtsi`."""
        self.mark(now)
        return False


class ClockDrift(ScheduledFault, OnCards):
    """One card samples on its own clock, which is slower than the other card's."""

    class Settings(ScheduledFault.Settings):
        """See `FaultSettings`."""

        drift: Annotated[float, Field(gt=0, le=0.5)] = 500e-6
        """Relative slowness of the clock. Two free clocks differ by 5 to 50e-6 (estimate; docs/hardware.md,
        "Two cards on one clock"); an input that counts noise instead of clock edges differs by any amount."""
        device: str | None = None
        """Name of the card; None selects the first card without an output."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        owners = {
            str(output["terminal"]).split("/")[0]
            for output in file.daq.settings.get("outputs", {}).values()
            if isinstance(output, dict) and "terminal" in output
        }
        without = (device for device in file.daq.settings.get("devices", {}) if device not in owners)
        self._device = settings.device or next(without, None)

    def lateness(self, device: str, times: FloatArray) -> FloatArray:
        """See `OnCards.lateness`."""
        if device != self._device:
            return np.zeros(len(times))
        late = np.asarray(self.settings.drift * np.maximum(times - self.begin, 0.0))
        if late[-1] > 0:
            self.mark(float(times[-1]))
        return late


class _OfCard(PerEventFault, OnCards):
    class Settings(PerEventFault.Settings):
        times: Annotated[int, Field(ge=1)] | None = 1
        device: str | None = None
        """Name of the card; None selects every card."""

    settings: Settings

    def _strikes(self, device: str, now: float) -> bool:
        return self.settings.device in (None, device) and self.fires(now)


class DaqOverrun(_OfCard):
    """The host reads too late, and its buffer overflows (NI's error -200279)."""

    def samples(self, device: str, now: float) -> None:
        """See `OnCards.samples`."""
        if self._strikes(device, now):
            raise SamplesLost(device, "overrun")


class DaqOverflow(_OfCard):
    """A card's own memory overflows (NI's error -200010)."""

    def samples(self, device: str, now: float) -> None:
        """See `OnCards.samples`."""
        if self._strikes(device, now):
            raise SamplesLost(device, "overflow")


class PlayCutOff(_OfCard):
    """A card's play ends before its time, at a block after `after`; the output holds its last value."""

    class Settings(_OfCard.Settings):
        """See `FaultSettings`."""

        how: Literal["underflow", "fifo", "stopped"] = "underflow"
        """underflow: the host's buffer ran empty (NI's -200290). fifo: the card's memory did (-200621).
        stopped: by another program, without an error."""

    settings: Settings

    def plays(self, device: str, now: float) -> None:
        """See `OnCards.plays`."""
        if self._strikes(device, now):
            raise PlayStopped(device, self.settings.how)
