"""Settings of a sound card as the DAQ: what its driver and its twin are told."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...base.bounded import Number, Positive, Strict
from ..config import RigFile

Corner = Annotated[float, Field(strict=True, ge=0, le=50)]


class Input(Strict):
    """One of the card's inputs."""

    input: Annotated[int, Field(strict=True, ge=1, le=64)]
    """Its number on the card, from 1."""
    volts_per_full_scale: Positive
    """Input at digital full scale (V peak), with the gain knob where it stays."""
    high_pass_hz: Corner = 5.0
    """Corner of its AC coupling, 0 if it is DC-coupled; an estimate (docs/hardware.md, "Sound card")."""


class Output(Strict):
    """One of the card's outputs."""

    output: Annotated[int, Field(strict=True, ge=1, le=64)]
    """Its number on the card, from 1."""
    volts_per_full_scale: Positive
    """Output at digital full scale (V peak), with the volume where it stays."""
    highest: Positive = 1.0
    """Largest output allowed (V peak)."""
    high_pass_hz: Corner = 5.0
    """As an input's."""


class SoundSettings(Strict):
    """The `[daq]` table of a rig file."""

    channels: Annotated[dict[str, Input], Field(min_length=1)]
    outputs: Mapping[str, Output] = {}
    device: Number | str = ""
    """Number or part of the name, as sounddevice lists it; empty for the system's default."""
    rate_hz: Positive = 48_000.0
    """Native sample rate (Hz): any other would be resampled by an unknown stage, and is refused."""
    latency: Annotated[int, Field(strict=True, ge=0, le=1_000_000)] | None = None
    """Frames from an output to an input that hears it by a cable; `haploop doctor` measures it."""
    monitor: str | None = None
    """Channel that hears the output when a play is connected: each play's latency is compared with it."""
    buffer: Literal["high", "low"] = "high"
    """PortAudio's buffers: low ones are shorter, and overrun sooner."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for what, numbers in (
            ("input", [(name, c.input) for name, c in self.channels.items()]),
            ("output", [(name, o.output) for name, o in self.outputs.items()]),
        ):
            taken: dict[int, str] = {}
            for name, number in numbers:
                if taken.setdefault(number, name) != name:
                    raise ValueError(
                        f"{what} {number} has two names, {taken[number]!r} and {name!r}: keep one"
                    )
        if self.monitor is not None and self.monitor not in self.channels:
            raise ValueError(
                f"monitor names {self.monitor!r}, and the channels are {', '.join(self.channels)}: name "
                "one of them"
            )
        if self.outputs and self.latency is None:
            raise ValueError(
                "outputs need latency: write latency = 0, connect an output to an input by a cable, and "
                "run `haploop doctor --loop CHANNEL`, which says what to write instead"
            )
        return self

    def contradictions(self, file: RigFile) -> Iterator[tuple[str, str]]:
        """See `haploop.instruments.config.contradictions`."""
        table = file.table.rate_hz if file.table is not None and self.outputs else self.rate_hz
        for where, rate_hz in (("at the top", file.rate_hz), ("in [table]", table)):
            if rate_hz != self.rate_hz:
                clause = (
                    f"the card runs at {self.rate_hz:g} samples/s, and rate_hz {where} is {rate_hz:g}: "
                    f"write rate_hz = {self.rate_hz:g} {where}"
                )
                yield "rate_hz", clause
        for kind in ("force", "acceleration", "displacement", "activation"):
            sensor = getattr(file.sensors, kind, None)
            if sensor is None or getattr(sensor, "ac_coupled", False):
                continue
            for name in sensor.channels:
                if name in self.channels and self.channels[name].high_pass_hz:
                    clause = (
                        f"{name!r} is AC-coupled, and [sensors.{kind}] needs its voltage at rest: write "
                        "high_pass_hz = 0 if the input is DC-coupled, or wire it to another DAQ"
                    )
                    yield f"channels.{name}", clause
