"""Settings of NI cards in a rig file, and the terminals that it names. NI's library is not needed here.

Here too are delays of the digital filters of NI's delta-sigma inputs, which no property of the driver tells
for all.

A sample is of a time before its clock edge: a filter of n samples needs as many after it (NI-DAQmx, "Alias
Rejection"). A module's figure is in its data sheet as "input delay"; docs/hardware.md says where each is
from.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from ...base.bounded import NotNegative, Positive, Strict

Terminal = Annotated[str, Field(pattern=r"^[^/\s]+/\w+$")]


class Channel(Strict):
    """An analog input, or a counter."""

    terminal: Terminal
    range: Positive
    """Full scale, +- V; the card takes its next wider range. Of a counter: the most that it counts, +-."""
    config: Literal["default", "diff", "rse", "nrse", "pseudodiff"] = "default"
    """Terminal configuration; the product's own unless another is named."""
    coupling: Literal["ac", "dc"] | None = None
    """Coupling of an input that has both; the product's own unless one is named."""
    excitation: Annotated[float, Field(strict=True, gt=0, le=0.02)] | None = None
    """Current that the input supplies to an IEPE sensor (A); none unless one is named. None takes more
    than 20 mA."""
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


class Output(Strict):
    """An analog output."""

    terminal: Terminal
    range: Positive = 10.0
    """Largest voltage to put out, +- V."""


class NiSettings(Strict):
    """The `[daq]` table of a rig file."""

    channels: dict[str, Channel]
    outputs: Mapping[str, Output] = {}
    devices: Mapping[str, str] = {}
    """Product of each device, to be checked against the one that the card reports."""
    products: Mapping[str, dict[str, Any]] = {}
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

    def contradictions(self, _file: object) -> Iterator[tuple[str, str]]:
        """Devices that only one of terminals and `devices` names, and products as NI does not write them."""
        wired = [("channels", name, channel.terminal) for name, channel in self.channels.items()]
        wired += [("outputs", name, output.terminal) for name, output in self.outputs.items()]
        known = {name.lower() for name in self.devices}
        for key, name, terminal in wired:
            device = device_of(terminal)
            if known and device.lower() not in known:
                yield (
                    key,
                    f"{name} is wired to {device}, which is none of devices ({', '.join(self.devices)}): "
                    "correct the terminal, or add the card there",
                )
        for product in self.devices.values():
            own = _as_ni_writes(product)
            if own is not None and product not in (own, *self.products):
                yield "devices", f"NI calls no card {product!r}: did you mean {own!r}?"


def _as_ni_writes(product: str) -> str | None:
    """The name that a driver reports for `usb6211` or `NI9234`; None for words of another kind."""
    plain = re.sub(r"[^a-z0-9]", "", product.lower()).removeprefix("ni")
    if re.fullmatch(r"9\d{3}", plain):
        return f"NI {plain}"
    card = re.fullmatch(r"(usb|pcie?|pxie?|cdaq)(\d{4})", plain)
    buses = {"pcie": "PCIe", "pxie": "PXIe", "cdaq": "cDAQ"}
    return f"{buses.get(card[1], card[1].upper())}-{card[2]}" if card else None


def device_of(terminal: str) -> str:
    """The card of a terminal such as `Dev1/ai0`."""
    return terminal.partition("/")[0]


@dataclass(frozen=True)
class Filter:
    """Delay of a converter's filter."""

    samples: float
    seconds: float = 0.0
    """Part that does not depend on the rate."""


_C_SERIES = 40 + 5 / 512
"""Samples of the filter of C Series modules of this kind."""
FILTERS: dict[str, Filter] = {
    "NI 9229": Filter(_C_SERIES, 3.3e-6),
    "NI 9230": Filter(32.0, 2.6e-6),
    "NI 9234": Filter(_C_SERIES, 2.6e-6),
    "NI 9237": Filter(_C_SERIES, 4.5e-6),
    "NI 9239": Filter(_C_SERIES, 3.3e-6),
    "NI 9250": Filter(32.0),
    "USB-4431": Filter(62.0),
    "PXI-4461": Filter(63.0),
    "PXI-4462": Filter(63.0),
    "PXIe-4464": Filter(63.0),
    "PXIe-4466": Filter(63.0),
    "PXIe-4480": Filter(63.0),
    "PXIe-4331": Filter(38.0),
}
"""Filters by product."""


def filter_delay(product: str, rate_hz: float) -> float:
    """Return the delay of a product's input filter at a sample rate (s); 0 for a product without one."""
    own = FILTERS.get(product)
    return 0.0 if own is None else own.samples / rate_hz + own.seconds
