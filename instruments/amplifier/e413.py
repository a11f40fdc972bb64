"""PI E-413.D2 piezo amplifier: an analog amplifier with its figures filled in.

Gain 50 is the paper's; the ranges and currents are estimates (docs/hardware.md, "Amplifier"), to be
overridden in the rig file by the lab's data sheet.
"""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from ...base.bounded import Negative, Positive
from ...base.clock import Clock
from ..config import RatingSource, require_source
from .analog import AnalogAmplifier, AnalogSettings

_OWN = {"min": -100.0, "max": 400.0, "gain": 50.0, "current_peak": 0.1, "current_average": 0.05}
"""The product's own figures: V, V, V per V, A, A."""


class E413(AnalogAmplifier):
    """See `Amplifier`."""

    own_gain = _OWN["gain"]

    class Settings(AnalogSettings):
        """The `[amplifier]` table of a rig file."""

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

    def __init__(self, settings: AnalogSettings) -> None:
        super().__init__(settings, "E-413.D2")

    @classmethod
    def open(cls, settings: AnalogSettings, clock: Clock) -> Self:
        """Return the amplifier; there is nothing to connect to."""
        return cls(settings)
