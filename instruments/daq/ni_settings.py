"""Settings of NI cards in a rig file, and the terminals that it names. NI's library is not needed here."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from ..bounded import NotNegative, Positive

Terminal = Annotated[str, Field(pattern=r"^[^/\s]+/\w+$")]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Channel(_Section):
    """An analog input, or a counter."""

    terminal: Terminal
    range: Positive
    """Full scale, +- V; the card takes its next wider range. Of a counter: the most that it counts, +-."""
    config: Literal["default", "diff", "rse", "nrse", "pseudodiff"] = "default"
    """Terminal configuration; the product's own unless another is named."""
    coupling: Literal["ac", "dc"] | None = None
    """Coupling of an input that has both; the product's own unless one is named."""
    excitation: Positive | None = None
    """Current that the input supplies to an IEPE sensor (A); none unless one is named."""
    bridge: Literal["full", "half", "quarter"] | None = None
    """Bridge whose supply and completion the input has; its rows are still volts at the terminal."""
    bridge_excitation: Positive = 2.5
    """Voltage that the input supplies to a bridge (V)."""
    bridge_resistance: Positive = 350.0
    """Nominal resistance of a bridge (Ohm)."""
    filter_delay: NotNegative | None = None
    """Delay of the input's digital filter (s); the product's own unless one is given."""
    counter: Literal["edges", "encoder"] | None = None
    """What a counter terminal ("Dev1/ctr0") counts, on the clock of the analog inputs, from 0 when a stream
    begins: rising edges, or the quarter periods of an encoder."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        named = bool(re.search(r"/_?ctr\d+$", self.terminal, re.IGNORECASE))
        if named is not (self.counter is not None):
            raise ValueError(
                f'{self.terminal} is a counter: say what it counts, counter = "edges" or "encoder"'
                if named
                else f"{self.terminal} is no counter: counter is for terminals such as Dev1/ctr0"
            )
        if self.bridge is not None and self.excitation is not None:
            raise ValueError("an input has either a bridge or an IEPE excitation: keep one")
        return self


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
    products: dict[str, dict[str, Any]] = {}
    """Products that haploop cannot simulate by itself, by name, each with the figures that a row of its table
    has (docs/hardware.md, "Other NI products"); twin and wire need them, and the cards do not."""
    ai_conv_rate: Positive | None = None
    """Conversions per second of a multiplexed card; the driver's choice unless one is named. Slower ones give
    a source of high impedance time to settle after the channel before it."""
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
