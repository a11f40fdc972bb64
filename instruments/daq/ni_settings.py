"""Settings of NI cards in a rig file, and the terminals that it names. NI's library is not needed here."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from ..bounded import Positive

__all__ = ["Channel", "NiSettings", "Output", "device_of"]

Terminal = Annotated[str, Field(pattern=r"^[^/\s]+/\w+$")]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Channel(_Section):
    """An analog input."""

    terminal: Terminal
    range: Positive
    """Full scale, +- V; the card takes its next wider range."""
    config: Literal["diff", "rse", "nrse"] = "diff"


class Output(_Section):
    """An analog output."""

    terminal: Terminal
    range: Positive = 10.0
    """Largest voltage to put out, +- V."""


class NiSettings(_Section):
    """The `[daq]` table of a rig file."""

    channels: dict[str, Channel]
    outputs: dict[str, Output] = {}
    devices: dict[str, str] = {}
    """Product of each device, to be checked against the one that the card reports."""
    server: str | None = None
    """NI device server as host:port; None takes the driver of this computer."""
    buffer_s: Positive = 10.0
    """Length of the host's buffer for a late reader (s)."""

    @field_validator("outputs")
    @classmethod
    def _one_name_each(cls, outputs: dict[str, Output]) -> dict[str, Output]:
        names: dict[str, str] = {}
        for name, output in outputs.items():
            first = names.setdefault(output.terminal.lower(), name)
            if first != name:
                raise ValueError(f"{output.terminal} has two names, {first!r} and {name!r}: keep one")
        return outputs


def device_of(terminal: str) -> str:
    """The card of a terminal such as `Dev1/ai0`."""
    return terminal.partition("/")[0]
