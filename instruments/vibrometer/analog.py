"""Any pick-up with an analog output: a Doppler vibrometer, a displacement laser, a glued accelerometer.

Set by hand and read through the DAQ: its settings are declared in the rig file, and confirmed by the
operator. A product whose figures are known is a subclass with these filled in (`pdv100`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Self

from pydantic import Field

from ...base.bounded import Finite, NotNegative, Positive, Strict
from ...base.clock import Clock
from ..config import RigFile, lacks, range_of
from .role import Quantity, Vibrometer, shown

_MOST_VOLTS, _LEAST_VOLTS = 50.0, 0.1
"""Volts that an output can have at full scale."""
_LOST_HZ = 60.0
"""Lower end of the band in which buttons are played: a high-pass above it hides what is to be judged."""


class AnalogVibrometer(Vibrometer):
    """See `Vibrometer`."""

    class Settings(Strict):
        """The `[vibrometer]` table of a rig file."""

        channel: str
        """Name of the DAQ channel that its output is wired to."""
        quantity: Quantity = "velocity"
        """What it shows."""
        scale: Positive
        """Scale of its output: m/s, m or m/s^2 per V."""
        range: Positive
        """Full scale: m/s, m or m/s^2."""
        zero: Finite = 0.0
        """Its output at zero (V): of a DC-coupled accelerometer as it lies, with gravity."""
        bandwidth_hz: Positive
        """Corner of its low-pass (Hz; one pole); of several in a row, the lowest."""
        high_pass_hz: NotNegative = 0.0
        """Corner of its high-pass (Hz; one pole); 0 without."""
        delay: Annotated[float, Field(strict=True, ge=0, lt=1)] = 0.0
        """Delay of its output (s)."""
        mass: NotNegative = 0.0
        """Mass that it adds to the table (kg): of an accelerometer, with its cable's share and its wax."""
        name: Annotated[str, Field(min_length=1, max_length=60, pattern=r"\S")]
        """Product."""
        source: Annotated[str, Field(min_length=5, max_length=200, pattern=r"\S")]
        """Where its figures are from: a data sheet with its version, a calibration sheet, or who measured."""

        def contradictions(self, file: RigFile) -> Iterator[tuple[str, str]]:
            """Yield keys of this table that the rest of the file contradicts, and how each is mended."""
            if self.quantity == "acceleration" and not self.mass:
                yield "mass", "an accelerometer loads the table: write its mass in kg (0.002 for 2 g)"
            if self.quantity != "acceleration" and self.mass:
                yield "mass", f"what shows {self.quantity} touches nothing: remove mass, or correct quantity"
            volts = abs(self.zero) + self.range / self.scale
            if not _LEAST_VOLTS <= volts <= _MOST_VOLTS:
                yield (
                    "scale",
                    f"its output would have {volts:.3g} V at full range: write range and scale in SI units "
                    "(0.005 m/s per V for 5 mm/s/V)",
                )
            yield from _filters(self, file)
            yield from _wired(self, file, volts)
            if file.abort.velocity is not None and self.quantity != "velocity":
                yield (
                    "quantity",
                    f"[abort] velocity cannot be tested on what shows {self.quantity}: write [abort] "
                    f"{self.quantity} instead",
                )

    def __init__(self, settings: Settings) -> None:
        self.identity = settings.name
        self.channel = settings.channel
        self.quantity = settings.quantity
        self.range = settings.range
        self.scale = settings.scale
        self.zero = settings.zero
        self.bandwidth_hz = settings.bandwidth_hz
        self.high_pass_hz = settings.high_pass_hz
        self.delay = settings.delay
        self.mass = settings.mass
        high = f"at {settings.high_pass_hz:g} Hz" if settings.high_pass_hz else "off"
        glued = f" of the {settings.mass * 1e3:g} g on the table" if settings.mass else ""
        self.declared = (
            f"{settings.name}: is the range{glued} {shown(self.quantity, self.range)}, the low-pass filter "
            f"{self.bandwidth_hz / 1e3:g} kHz and the high-pass filter {high}?"
        )

    @staticmethod
    def hardware(settings: object) -> tuple[str, ...]:
        """See `Driver.hardware`: none, because it is measured through the DAQ."""
        return ()

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Return the vibrometer; there is nothing to connect to."""
        return cls(settings)

    def signal_level(self) -> float | None:
        """Return None: the level, if any, is shown only on its display."""
        return None

    def close(self) -> None:
        """Do nothing: there is no connection."""


def _filters(settings: AnalogVibrometer.Settings, file: RigFile) -> Iterator[tuple[str, str]]:
    nyquist = file.table.rate_hz / 2 if file.table else float("inf")
    if settings.bandwidth_hz > nyquist:
        yield (
            "bandwidth_hz",
            f"{settings.bandwidth_hz:g} Hz is beyond half of the table's rate ({nyquist:g} Hz), and what "
            "lies above would alias: set a lower low-pass filter on the instrument, write the card's own "
            "filter if it has one, or raise rate_hz in [table]",
        )
    if settings.high_pass_hz >= min(_LOST_HZ, settings.bandwidth_hz):
        yield (
            "high_pass_hz",
            f"a high-pass of {settings.high_pass_hz:g} Hz hides motion that is to be judged: switch it off, "
            f"or set it below {min(_LOST_HZ, settings.bandwidth_hz):g} Hz",
        )


def _wired(settings: AnalogVibrometer.Settings, file: RigFile, volts: float) -> Iterator[tuple[str, str]]:
    if lacks(file, "channels", settings.channel):
        yield (
            "channel",
            f"there is no channel {settings.channel!r} in [daq.channels]: name the one that it is wired to",
        )
    channel = range_of(file, "channels", settings.channel)
    if channel is not None and channel < 0.99 * volts:
        full = shown(settings.quantity, settings.range)
        yield (
            "range",
            f"its output reaches {volts:.3g} V at {full}, and the channel {settings.channel!r} ends at "
            f"{channel:g} V: write range = {volts:.3g} at that channel, or a range of "
            f"{settings.scale * channel:.3g} here",
        )
