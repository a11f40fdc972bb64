"""Polytec PDV-100: an analog vibrometer with its figures filled in; its settings are declared.

The scale of the 20 mm/s range and the 1.1 ms delay were found; the other ranges and the filters
are estimates (docs/hardware.md, "PDV-100").
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator

from ...base.bounded import Strict
from .analog import AnalogVibrometer

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


class Pdv100(AnalogVibrometer):
    """See `Vibrometer`."""

    taped = True

    class Settings(Strict):
        """The `[vibrometer]` table of a rig file."""

        channel: str
        """Name of the DAQ channel that its output is wired to."""
        range: Range = 0.02
        low_pass_hz: Literal[1000, 5000, 22000] = 5000

    def __init__(self, settings: Settings) -> None:
        filled_in = AnalogVibrometer.Settings(
            channel=settings.channel,
            scale=settings.range / _FULL_SCALE,
            range=settings.range,
            bandwidth_hz=settings.low_pass_hz,
            delay=_DELAY,
            name="PDV-100",
            source='docs/hardware.md, "PDV-100"',
        )
        super().__init__(filled_in)
