"""Polytec PDV-100: set by hand and read through its analog output, so its settings are declared.

The scale of the 20 mm/s range and the 1.1 ms delay were found; the other ranges and the filters
are estimates (docs/hardware.md, "PDV-100").
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict

from ..clock import Clock
from .role import Vibrometer

__all__ = ["Pdv100"]

_RANGES = (0.02, 0.1, 0.5)


def _known(value: float) -> float:
    if value not in _RANGES:
        raise ValueError(f"the ranges are {', '.join(map(str, _RANGES))} m/s")
    return value


Range = Annotated[float, AfterValidator(_known)]

_FULL_SCALE = 4.0
"""Output at full range (V): 20 mm/s at 5 mm/s/V (docs/hardware.md, "PDV-100")."""
_DELAY = 1.1e-3
"""Delay of the output (s; docs/hardware.md, "PDV-100")."""


class Pdv100(Vibrometer):
    """See `Vibrometer`."""

    taped = True

    class Settings(BaseModel):
        """The `[vibrometer]` table of a rig file."""

        model_config = ConfigDict(frozen=True, extra="forbid")

        channel: str
        """Name of the DAQ channel that its output is wired to."""
        range: Range = 0.02
        low_pass_hz: Literal[1000, 5000, 22000] = 5000

    def __init__(self, settings: Settings) -> None:
        self.identity = "PDV-100"
        self.channel = settings.channel
        self.range = settings.range
        self.scale = settings.range / _FULL_SCALE
        self.bandwidth_hz = float(settings.low_pass_hz)
        self.delay = _DELAY
        self.declared = (
            f"PDV-100: is the range {settings.range * 1e3:g} mm/s, the low-pass filter "
            f"{settings.low_pass_hz / 1e3:g} kHz and the high-pass filter off?"
        )

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: none, because it is measured through the DAQ."""
        return ()

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Return the vibrometer; there is nothing to connect to."""
        return cls(settings)

    def signal_level(self) -> float | None:
        """Return None: the level is shown only on its display."""
        return None

    def close(self) -> None:
        """Do nothing: there is no connection."""
