"""Polytec OFV-5000 vibrometer controller over its serial port.

Its range is read back, because the data's scale depends on it. The commands are those of public code
(docs/hardware.md, "OFV-5000"); the indices of the decoders differ from site to site.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Literal, Self, TypeVar

from pydantic import Field

from ...base.bounded import Baud, Positive, Timeout
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError
from ..driver import one_name
from ..transport import Line, SerialLine, SerialSettings
from .ofv5000_codec import (
    Command,
    duration_of,
    frequency_of,
    is_command,
    is_untold,
    level_of,
    ranges_of,
    scale_of,
    scale_text,
)
from .role import Vibrometer

Value = TypeVar("Value")

_NAME = "OFV-5000"
_ECHOES = 8
"""Most echoed commands before the answer, when the interface's echo is on."""
_ENDS = {"lf": b"\n", "cr": b"\r", "cr-lf": b"\r\n"}
_LOOK = 0.5
"""Polling interval of a focus search (s)."""


class Ofv5000(Vibrometer):
    """See `Vibrometer`."""

    taped = True

    class Settings(SerialSettings):
        """The `[vibrometer]` table of a rig file."""

        port: Annotated[str, Field(min_length=1)]
        """Serial port (COM3, /dev/ttyUSB0), or a URL of pyserial's (socket://HOST:PORT)."""
        channel: str
        """Name of the DAQ channel that its output is wired to."""
        scale: Positive
        """Scale that the decoder is set to (m/s per V): 0.005 is its range `5mm/s/V`."""
        decoder: Annotated[str, Field(pattern=r"^VeloDec,\d$")] = "VeloDec,0"
        """The velocity decoder whose output is wired (VD-08 is often VeloDec,0 and VD-09 VeloDec,1)."""
        full_scale: Positive = 10.0
        """Output at full range (V; estimate; docs/hardware.md, "OFV-5000")."""
        bandwidth_hz: Positive | None = None
        """Bandwidth (Hz) for a decoder that reports none; otherwise the lower of both holds."""
        delay: Annotated[float, Field(strict=True, ge=0, le=0.1)] | None = None
        """Signal delay (s), for a controller that does not tell it."""
        range_declared: bool = False
        """True for a controller that does not tell its range: the operator confirms `scale`."""
        baud: Baud = 115200
        terminator: Literal["lf", "cr", "cr-lf"] = "lf"
        """End of a line, in both directions."""
        timeout: Timeout = 2.0
        """Time for a command to be answered completely (s)."""
        focus_timeout: Positive = 30.0
        """Time for a focus search (s)."""

    def __init__(self, settings: Settings, clock: Clock, line: Line) -> None:
        """Read the settings of the controller on `line`. Raises as `open` does."""
        self._settings = settings
        self._clock = clock
        self._line = line
        self.channel = settings.channel
        self.identity = self._identity()
        self.delay = self._delay()
        self.bandwidth_hz = self._bandwidth()
        self.declared = None
        if settings.range_declared:
            self.declared = f"{self.identity}: is {settings.decoder} set to {scale_text(settings.scale)}?"
        self._take(self._range())

    @classmethod
    def connect(cls, settings: Settings, clock: Clock) -> Self:
        """Connect as `open`, but accept any range that the controller is set to."""
        end = _ENDS[settings.terminator]
        line = SerialLine(_NAME, settings.port, settings.baud, settings.timeout, how=settings, end=end)
        try:
            return cls(settings, clock, line)
        except BaseException:
            line.close()
            raise

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: the port."""
        return (one_name(settings.port),)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Connect, read every setting and change none.

        Raises ConfigurationError when the controller is set to another range than the rig file
        says, InstrumentError when it does not answer as an OFV-5000 does.
        """
        opened = cls.connect(settings, clock)
        try:
            opened.check_range()
        except BaseException:
            opened.close()
            raise
        return opened

    def check_range(self) -> None:
        """Read the range again. Raises ConfigurationError when it is not the rig file's."""
        self._take(self._range())
        wanted = self._settings.scale
        if not math.isclose(self.scale, wanted, rel_tol=1e-3):
            raise ConfigurationError(
                f"{self.identity}: {self._settings.decoder} is set to the range "
                f"{scale_text(self.scale)}, but the rig file says {scale_text(wanted)}: "
                f"set the range, or correct 'scale' in [vibrometer].{self._known()}"
            )

    def set_range(self, scale: float) -> None:
        """Switch the decoder to the range of `scale` (m/s per V), and read that back.

        Raises InstrumentError when another range reads back: the decoder lacks this one.
        """
        self._send(Command("Set", self._settings.decoder, "Range", scale_text(scale)))
        self._take(self._range())
        if not math.isclose(self.scale, scale, rel_tol=1e-3):
            raise InstrumentError(
                f"{self.identity}: {self._settings.decoder} was given the range "
                f"{scale_text(scale)} but reads {scale_text(self.scale)}: "
                f"choose a range that it has.{self._known()}"
            )

    def signal_level(self) -> float:
        """See `Vibrometer.signal_level`."""
        return self._value(Command("Get", "SignalLevel,0", "Value"), level_of)

    def autofocus(self) -> None:
        """Search the whole span for the focus, and return when it is found.

        Raises InstrumentError when it is not found within `focus_timeout`.
        """
        head = "SensorHead,0"
        self._send(Command("Set", head, "AutoFocusSpan", "Full"))
        self._send(Command("Set", head, "AutoFocus", "Search"))
        deadline = self._clock.now() + self._settings.focus_timeout
        while self._ask(Command("Get", head, "AutoFocusResult")) != "Found":
            if self._clock.now() >= deadline:
                raise InstrumentError(
                    f"{self.identity} found no focus within {self._settings.focus_timeout:g} s: "
                    "aim the laser at the table and look at its signal level."
                )
            self._clock.sleep(_LOOK)

    def close(self) -> None:
        """See `Vibrometer.close`."""
        self._line.close()

    def _identity(self) -> str:
        command = Command("GetDevInfo", "Controller,0", "Name")
        name = self._ask(command)
        if not name.startswith(_NAME):
            raise InstrumentError(
                f"What is at {self._settings.port} calls itself {name[:60]!r} in answer to "
                f"'{command}', not {_NAME}: correct 'port' in [vibrometer]."
            )
        return name

    def _range(self) -> float:
        """Scale that the controller tells, or the rig file's, where that is to be confirmed."""
        if self._settings.range_declared:
            return self._settings.scale
        try:
            return self._get("Range", scale_of)
        except InstrumentError as error:
            raise InstrumentError(
                f"{str(error).rstrip('.')}; where this controller does not tell its range, give "
                "range_declared = true in [vibrometer], and the operator confirms it."
            ) from None

    def _delay(self) -> float:
        """Delay that the rig file declares, or the controller tells."""
        if self._settings.delay is not None:
            return self._settings.delay
        told = self._get("SignalDelay", lambda text: None if is_untold(text) else duration_of(text))
        if told is None:
            raise ConfigurationError(
                f"{self.identity}: {self._settings.decoder} tells no delay: give 'delay' in [vibrometer]."
            )
        return told

    def _known(self) -> str:
        """The ranges that the decoder has, as the end of a sentence; "" where it does not list them."""
        try:
            scales = ranges_of(self._ask(Command("GetDevInfo", self._settings.decoder, "Range")))
        except (InstrumentError, ValueError):
            return ""
        return f" It has {', '.join(map(scale_text, scales))}." if scales else ""

    def _bandwidth(self) -> float:
        declared = self._settings.bandwidth_hz
        try:
            reported = self._get("MaxFreq", frequency_of)
        except InstrumentError:
            if declared is None:
                raise
            reported = None  # no such command in this firmware
        known = [f for f in (reported, declared) if f is not None]
        if not known:
            raise ConfigurationError(
                f"{self.identity}: {self._settings.decoder} reports no highest frequency: "
                "give 'bandwidth_hz' in [vibrometer]."
            )
        return min(known)

    def _take(self, scale: float) -> None:
        # Frozen for everybody else, once a rig has opened it: these are the controller's own words.
        vars(self).update(scale=scale, range=scale * self._settings.full_scale)

    def _get(self, attribute: str, parse: Callable[[str], Value]) -> Value:
        return self._value(Command("Get", self._settings.decoder, attribute), parse)

    def _value(self, command: Command, parse: Callable[[str], Value]) -> Value:
        reply = self._ask(command)
        try:
            return parse(reply)
        except ValueError as error:
            raise InstrumentError(
                f"{_NAME} at {self._settings.port} answered '{command}' with {reply[:60]!r}, which is "
                f"{error}: check the decoder's index and the serial cable."
            ) from None

    def _ask(self, command: Command) -> str:
        self._send(command)
        for _ in range(_ECHOES):
            reply = self._line.receive(str(command))
            if not is_command(reply):
                return reply
        raise InstrumentError(
            f"{_NAME} at {self._settings.port} only sends commands back: is a loop-back plugged in?"
        )

    def _send(self, command: Command) -> None:
        self._line.send(str(command))
