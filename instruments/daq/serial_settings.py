"""Settings of a board on a serial port: what its driver and its twin are told."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ...base.bounded import Baud, Finite, NotNegative, Positive
from ..config import RigFile, lacks
from .serial_codec import Framing

_COUNTS = 100.0
"""Whole numbers in a range from which a line of text has whole numbers."""


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Column(_Section):
    """A channel: a column of the board's frames."""

    column: Annotated[int, Field(strict=True, ge=1, le=64)]
    """Its number in the frame, from 1."""
    scale: Finite = 1.0
    """Volts for each unit that the board sends: an HX711 with 5 V and gain 128 has 20 mV / 2^23."""
    offset: Finite = 0.0
    """Volts at 0."""
    range: Positive
    """Full scale (+- V)."""

    @model_validator(mode="after")
    def _scaled(self) -> Self:
        if self.scale == 0:
            raise ValueError("a scale of 0 would lose what is measured: give volts for each unit")
        return self


class SharedEdge(_Section):
    """A signal that is wired to the DAQ and to the board: the button's contact, or a line that the board
    pulls.
    """

    channel: str
    """Channel of the DAQ."""
    threshold: Finite = 2.5
    """Its level (V)."""
    column: Annotated[int, Field(strict=True, ge=1, le=64)]
    """Column of the board's frames, from 1."""
    level: Finite = 0.5
    """Level in that column, as the board sends it."""


class SerialSettings(_Section):
    """The `[daq]` or `[adc]` table of a rig file."""

    port: str
    baud: Baud = 115_200
    rate_hz: Positive
    """Frames per second; recorded along, the nominal rate is enough."""
    frame: Framing
    channels: Annotated[dict[str, Column], Field(min_length=1)]
    counter: Annotated[int, Field(strict=True, ge=1, le=64)] | None = None
    """Column that counts frames, if there is one: then every lost one is known."""
    counter_modulo: Annotated[int, Field(strict=True, ge=2, le=1 << 32)] = 65_536
    """What the counter begins anew at."""
    start: str = ""
    """Text to send for the board to begin, such as `s\\n`."""
    latency: NotNegative = 0.005
    """Shortest time from a sample to its arrival (s; estimate: half a period of the board's filter and a
    transfer). An edge measures it."""
    latency_error: NotNegative = 0.01
    """How far off that may be (s; estimate: a USB adapter waits up to 16 ms)."""
    bridge: NotNegative = 0.05
    """Longest time of lost frames that is bridged when recorded along (s)."""
    edge: SharedEdge | None = None

    def digit(self, channel: Column) -> float:
        """What the last digit of a channel's column counts, in the board's units.

        1 for whole numbers: integers of a structure, and lines of text unless `frame.decimals` says more or
        the range has less than a hundred of them, as that of a board that prints volts.
        """
        if self.frame.whole(channel.column - 1):
            return 1.0
        if self.frame.decimals is not None:
            return float(10.0**-self.frame.decimals)
        steps = 2 * channel.range / abs(channel.scale)
        if steps >= _COUNTS and self.frame.struct is None:
            return 1.0
        return float(10.0 ** np.floor(np.log10(steps) - 5))

    @model_validator(mode="after")
    def _columns(self) -> Self:
        width = self.frame.width
        named = {f"channels.{name}": channel.column for name, channel in self.channels.items()}
        named |= {"counter": self.counter} if self.counter else {}
        named |= {"edge": self.edge.column} if self.edge else {}
        for name, column in named.items():
            if column > width:
                raise ValueError(f"{name} is column {column}, and a frame has {width}: correct one of them")
        taken: dict[int, str] = {}
        for name, channel in self.channels.items():
            first = taken.setdefault(channel.column, name)
            if first != name:
                raise ValueError(f"column {channel.column} has two names, {first!r} and {name!r}: keep one")
        if self.counter in taken:
            raise ValueError(f"column {self.counter} is the counter and {taken[self.counter]!r}: keep one")
        bits = 10 * self.rate_hz * len(self.frame.encode([0.0] * width))
        if self.frame.struct is not None and bits > self.baud:
            raise ValueError(
                f"{self.rate_hz:g} frames a second are {bits:g} baud, and baud is {self.baud}: raise "
                "baud, there and on the board"
            )
        return self

    def contradictions(self, file: RigFile) -> Iterator[tuple[str, str]]:
        """See `haploop.instruments.config.contradictions`."""
        if file.adc is None or file.adc.settings.get("port") != self.port:
            if file.rate_hz != self.rate_hz:
                clause = (
                    f"the only DAQ sends {self.rate_hz:g} frames a second, and recordings have rate_hz = "
                    f"{file.rate_hz:g}: write rate_hz = {self.rate_hz:g} at the top"
                )
                yield "rate_hz", clause
            return
        known = file.daq.settings.get("channels")
        for name in self.channels:
            if isinstance(known, Mapping) and name in known:
                yield "channels", f"{name!r} is also a channel of [daq]: give one of them another name"
        if self.edge is not None and lacks(file, "channels", self.edge.channel):
            clause = f"{self.edge.channel!r} is no channel of [daq]: name one of {', '.join(known or ())}"
            yield "edge", clause
