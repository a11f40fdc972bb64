"""Faults of the DAQ's cards and of the cable between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...base.arrays import FloatArray
from ...base.bounded import Count, NotNegative, Positive
from ...instruments.config import RigFile
from ...nidaqmx_twin.nodes import PlayStopped, SamplesLost
from ..plant import FaultSettings, OnCards, PerEventFault, ScheduledFault

_MULTIPLEXER = 100e-12
"""Capacitance of a card's multiplexer and amplifier (F; estimate: X Series inputs have 100 pF)."""


class RtsiMissing(OnCards):
    """The RTSI cable between the cards is missing."""

    def rtsi(self, now: float) -> bool:
        self.mark(now)
        return False


class ClockDrift(ScheduledFault, OnCards):
    """One card samples on its own clock, which is slower than the other card's."""

    class Settings(ScheduledFault.Settings):
        drift: Annotated[float, Field(strict=True, gt=0, le=0.5)] = 500e-6
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
        if device != self._device:
            return np.zeros(len(times))
        late = np.asarray(self.settings.drift * np.maximum(times - self.begin, 0.0))
        if late[-1] > 0:
            self.mark(float(times[-1]))
        return late


class SourceImpedance(OnCards):
    """A source of high impedance behind a multiplexer: the channel before it is seen in it, as a ghost.

    The multiplexer's capacitance arrives with the volts of the channel before and is charged by the source in
    the time from one conversion to the next. A capacitor at the source gives that charge at once, and is
    charged through the source from scan to scan.
    """

    class Settings(FaultSettings):
        channel: str
        ohm: Positive = 32e3
        """Output impedance (Ohm): an ADXL335's (docs/hardware.md, "Accelerometer")."""
        farad: NotNegative = 0.0
        """Capacitor at the output (F)."""

    settings: Settings

    def scanned(self, nodes: Sequence[str], volts: FloatArray, times: FloatArray) -> None:
        if self.settings.channel not in nodes or len(nodes) < 2:
            return
        row = list(nodes).index(self.settings.channel)
        gap = float(times[row, 0] - times[row - 1, 0]) if row else math.inf
        if not 0 < gap < math.inf:
            return
        difference = volts[row - 1] - volts[row]
        volts[row] += self._left(gap, times[row]) * difference
        if np.abs(difference).max() > 0:
            self.mark(float(times[row, 0]))

    def _left(self, gap: float, times: FloatArray) -> float:
        """Part of the difference that is still there at the conversion, `gap` (s) after the one before."""
        if not self.settings.farad:
            return math.exp(-gap / (self.settings.ohm * _MULTIPLEXER))
        shared = _MULTIPLEXER / (_MULTIPLEXER + self.settings.farad)
        period = float(times[1] - times[0]) if len(times) > 1 else math.inf
        return min(1.0, shared / -math.expm1(-period / (self.settings.ohm * self.settings.farad)))


class _OfCard(PerEventFault, OnCards):
    class Settings(PerEventFault.Settings):
        times: Count | None = 1
        device: str | None = None
        """Name of the card; None selects every card."""

    settings: Settings

    def _strikes(self, device: str, now: float) -> bool:
        return self.settings.device in (None, device) and self.fires(now)


class DaqOverrun(_OfCard):
    """The host reads too late, and its buffer overflows (NI's error -200279)."""

    def samples(self, device: str, now: float) -> None:
        if self._strikes(device, now):
            raise SamplesLost(device, "overrun")


class DaqOverflow(_OfCard):
    """A card's own memory overflows (NI's error -200010)."""

    def samples(self, device: str, now: float) -> None:
        if self._strikes(device, now):
            raise SamplesLost(device, "overflow")


class PlayCutOff(_OfCard):
    """A card's play ends before its time, at a block after `after`; the output holds its last value."""

    class Settings(_OfCard.Settings):
        how: Literal["underflow", "fifo", "stopped"] = "underflow"
        """underflow: the host's buffer ran empty (NI's -200290). fifo: the card's memory did (-200621).
        stopped: by another program, without an error."""

    settings: Settings

    def plays(self, device: str, now: float) -> None:
        if self._strikes(device, now):
            raise PlayStopped(device, self.settings.how)
