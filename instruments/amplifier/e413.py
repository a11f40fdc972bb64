"""PI E-413.D2 piezo amplifier: no digital interface, so its driver is arithmetic and limits.

Gain 50 is the paper's; the ranges and currents are estimates (docs/hardware.md, "Amplifier"), to be
overridden in the rig file by the lab's data sheet.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Self

from pydantic import BaseModel, ConfigDict, model_validator

from ..arrays import FloatArray
from ..bounded import Negative, Positive
from ..clock import Clock
from ..config import RatingSource, require_source
from ..limits import Limits
from .role import Amplifier

__all__ = ["E413"]


_OWN = {"min": -100.0, "max": 400.0, "gain": 50.0, "current_peak": 0.1, "current_average": 0.05}
"""The product's own figures: V, V, V per V, A, A."""


class E413(Amplifier):
    """See `Amplifier`."""

    own_gain = _OWN["gain"]
    arithmetic = True

    class Settings(BaseModel):
        """The `[amplifier]` table of a rig file."""

        model_config = ConfigDict(frozen=True, extra="forbid")

        input: str | dict[str, str]
        """Name of the output that feeds it; names by patch when it has a channel for each patch."""
        gain: Positive = _OWN["gain"]
        min: Negative = _OWN["min"]
        max: Positive = _OWN["max"]
        current_peak: Positive = _OWN["current_peak"]
        current_average: Positive = _OWN["current_average"]
        rating_source: RatingSource = None

        @model_validator(mode="after")
        def _sourced(self) -> Self:
            for key, own in _OWN.items():
                value = getattr(self, key)
                if value != own if key == "gain" else abs(value) > abs(own):
                    require_source("E-413.D2", key, value, own, self.rating_source)
            return self

    def __init__(self, settings: Settings) -> None:
        self.identity = "E-413.D2"
        self.input = settings.input if isinstance(settings.input, str) else ""
        self.inputs = MappingProxyType(dict(settings.input) if isinstance(settings.input, dict) else {})
        self._settings = settings

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Return the amplifier; there is nothing to connect to."""
        return cls(settings)

    def limits(self, patches: int) -> Limits:
        """See `Amplifier.limits`; a channel's current does not depend on how many patches share it."""
        s = self._settings
        return Limits(min=s.min, max=s.max, current_peak=s.current_peak, current_average=s.current_average)

    def to_input(self, drive: FloatArray) -> FloatArray:
        """See `Amplifier.to_input`."""
        return drive / self._settings.gain
