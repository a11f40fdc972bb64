"""Any analog voltage amplifier: no digital interface, so its driver is arithmetic and limits.

Its figures stand in the rig file, with their source. A product whose figures are known is a subclass with
these filled in (`e413`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import MappingProxyType
from typing import Annotated, Self

from pydantic import Field

from ...base.arrays import FloatArray
from ...base.bounded import NotPositive, Positive, Strict
from ...base.clock import Clock
from ..config import RigFile
from ..limits import Limits
from .role import Amplifier


class Monitor(Strict):
    """An output of the amplifier that shows what it puts out, on a channel of the DAQ."""

    channel: Annotated[str, Field(min_length=1)]
    """Name of the DAQ channel that it is wired to."""
    scale: Positive
    """V at the actuator per V of the monitor (100 for a monitor of 1:100)."""


class AnalogSettings(Strict):
    """Keys that every analog amplifier has."""

    input: str | dict[str, str]
    """Name of the output that feeds it; names by patch when it has a channel for each patch."""
    gain: Positive
    """V per V."""
    inverting: bool = False
    """True when a positive input makes a negative output."""
    min: NotPositive
    """Lowest output (V): 0 for a unipolar amplifier."""
    max: Positive
    """Highest output (V)."""
    current_peak: Positive
    """A."""
    current_average: Positive
    """A, over the worst second."""
    slew: Positive | None = None
    """Largest slew rate of its output (V/s)."""
    bandwidth_hz: Positive = 5000.0
    """Corner of its output (Hz), of the simulated one: a real one's is measured with the response."""
    monitor: Monitor | None = None
    """Its voltage monitor, as drive monitor in place of `[sensors.drive]`, on a rig without a relay."""

    def contradictions(self, file: RigFile) -> Iterator[tuple[str, str]]:
        """Yield keys of this table that the rest of the file contradicts, and how each is mended."""
        if file.table is not None and self.min == 0:
            yield (
                "min",
                "an output of 0 V and above cannot play a drive, which swings about 0 V without a bias: use "
                "an amplifier that goes below 0 V (min = -50), or its bipolar range",
            )
        generator = file.generator.settings if file.generator else {}
        if self.inverting and generator.get("output") == self.input:
            yield (
                "inverting",
                "a generator's waveform is not turned over: feed the amplifier from the DAQ, or use its "
                "non-inverting input",
            )
        if self.monitor is not None and file.wiring == "relay" and file.relay is not None:
            yield (
                "monitor",
                "an amplifier's own monitor lies before the relay, and does not show what a patch gets: put "
                "a divider behind the relay into [sensors.drive], and remove monitor",
            )


class AnalogAmplifier(Amplifier):
    """See `Amplifier`."""

    arithmetic = True

    class Settings(AnalogSettings):
        """The `[amplifier]` table of a rig file."""

        name: Annotated[str, Field(min_length=1, max_length=60, pattern=r"\S")]
        """Product."""
        source: Annotated[str, Field(min_length=5, max_length=200, pattern=r"\S")]
        """Where its figures are from: a data sheet with its version, or who measured them."""

    def __init__(self, settings: AnalogSettings, identity: str = "") -> None:
        self.identity = identity or str(getattr(settings, "name", ""))
        self.input = settings.input if isinstance(settings.input, str) else ""
        self.inputs = MappingProxyType(dict(settings.input) if isinstance(settings.input, dict) else {})
        self._settings = settings

    @staticmethod
    def hardware(settings: AnalogSettings) -> tuple[str, ...]:
        """See `Driver.hardware`: none, because it is driven through the DAQ."""
        return ()

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Return the amplifier; there is nothing to connect to."""
        return cls(settings)

    def limits(self, patches: int) -> Limits:
        """See `Amplifier.limits`; a channel's current does not depend on how many patches share it."""
        s = self._settings
        return Limits(
            min=s.min,
            max=s.max,
            slew=math.inf if s.slew is None else s.slew,
            current_peak=s.current_peak,
            current_average=s.current_average,
        )

    def to_input(self, drive: FloatArray) -> FloatArray:
        """See `Amplifier.to_input`."""
        return drive / (-self._settings.gain if self._settings.inverting else self._settings.gain)
