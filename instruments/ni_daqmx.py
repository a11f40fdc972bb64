"""NI DAQ cards through the public API of `nidaqmx`. (Settings by the lead, in use by the twin: keep
`devices`; the driver itself is being written.)"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field

from instruments.clock import Clock
from instruments.daq import Daq

__all__ = ["NiDaq"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Input(BaseModel):
    """One analog input of a rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    terminal: str
    range: Positive = 10.0
    config: Literal["diff", "rse", "nrse"] = "diff"


class Output(BaseModel):
    """One analog output of a rig file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    terminal: str
    range: Positive = 10.0


class NiDaq(Daq):
    """See `Daq`."""

    class Settings(BaseModel):
        """The `[daq]` table of a rig file."""

        model_config = ConfigDict(frozen=True, extra="forbid")

        devices: dict[str, str]
        """Product of each device, as the driver names it: what is expected to be found."""
        channels: dict[str, Input]
        outputs: dict[str, Output] = {}
        server: str | None = None
        """host:port of a device server; None is the driver of this computer."""
        buffer_s: Positive = 10.0

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Connect."""
        raise NotImplementedError
