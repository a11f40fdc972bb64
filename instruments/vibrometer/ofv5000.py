r"""Polytec OFV-5000 vibrometer controller over its serial port.

Its range is read back, because the data's scale depends on it. The commands are those of public code
(docs/hardware.md, "OFV-5000"); the indices of the decoders differ from site to site.

Driver and wire share the codec of its lines: text in, values out. A command is `Get,DEVICE,INDEX,ATTRIBUTE`,
`GetDevInfo,...` alike, or `Set,...,VALUE`; each line ends with `\n`, and a Set is not answered
(docs/hardware.md, "OFV-5000": as public code sends them). The forms of the replies are from the same code,
except where a function says that its form is an estimate.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, Self, TypeVar, cast

from pydantic import Field

from ...base.bounded import Baud, Positive, Timeout
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError
from ..driver import one_name
from ..transport import Line, SerialLine, SerialSettings
from .role import Vibrometer

Verb = Literal["Get", "Set", "GetDevInfo"]

LEVEL_FULL = 512
"""Signal level of full light (found for VibroFlex, Polytec's newer controller; docs/hardware.md,
"OFV-5000")."""

_NUMBER = r"(?P<number>[+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,2})?)"
_VELOCITY = {"um": 1e-6, "µm": 1e-6, "mm": 1e-3, "m": 1.0}
_TIME = {"ns": 1e-9, "us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "": 1e-6}
_FREQUENCY = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "": 1.0}
_SECONDS = 1e-2
"""A delay without a unit below this is in seconds, as 1.23E-05 is; others are in microseconds (estimate)."""
_SENSITIVITIES = (1e-6, 10.0)
"""Valid scales (m/s per V); like the two below, wider than any product's: beyond is a garbled line."""
_DELAYS = (0.0, 0.1)
_FREQUENCIES = (1.0, 1e9)
_BARE = 1e3
"""Hz: no decoder ends below; a smaller number without a unit has lost it."""


@dataclass(frozen=True)
class Command:
    """One line to the controller. `str(command)` is the text that is sent."""

    verb: Verb
    device: str
    """The device and its index: `VeloDec,0`."""
    attribute: str
    value: str | None = None
    """Value to set; None in a query. May contain commas."""

    def __str__(self) -> str:
        parts = [self.verb, self.device, self.attribute]
        return ",".join(parts if self.value is None else [*parts, self.value])

    @classmethod
    def parse(cls, text: str) -> Command | None:
        """Parse a line as a command; None for any other line."""
        words = text.strip().split(",", 4)
        verb, wanted = words[0], 5 if words[0] == "Set" else 4
        if verb not in ("Get", "Set", "GetDevInfo") or len(words) != wanted or not words[2].isdigit():
            return None
        value = words[4] if wanted == 5 else None
        return cls(cast(Verb, verb), f"{words[1]},{words[2]}", words[3], value)


def is_command(text: str) -> bool:
    """True when a received line is the interface's echo of a command, not an answer."""
    return text.startswith(("Get,", "Set,", "GetDevInfo,"))


def scale_of(text: str) -> float:
    """Parse a velocity decoder's range, `5mm/s/V`, to m/s per V. Raises ValueError."""
    return _quantity(text, r"(?P<unit>[uµ]m|mm|m)\s*/\s*s\s*/\s*V", _VELOCITY, _SENSITIVITIES)


def scale_text(scale: float) -> str:
    """Format a scale (m/s per V) as the controller names its ranges, in mm/s/V."""
    return f"{scale * 1e3:.6g}mm/s/V"


def duration_of(text: str) -> float:
    """Parse a signal delay, `12.3 us`, `12.3` or `1.23E-05`, to seconds. Raises ValueError.

    Public code reads only the number; the unit of a bare number is an estimate.
    """
    units = _TIME
    if re.fullmatch(_NUMBER, text.strip(), re.ASCII) and float(text) < _SECONDS:
        units = {**_TIME, "": 1.0}
    return _quantity(text, r"(?P<unit>[nuµm]?s)?", units, _DELAYS)


def frequency_of(text: str) -> float | None:
    """Parse a highest frequency, `20 kHz` or `20000`, to Hz; None where it is not told. Raises ValueError."""
    if is_untold(text):
        return None
    found = _quantity(text, r"(?P<unit>[kKmM]?[hH][zZ])?", _FREQUENCY, _FREQUENCIES)
    if found < _BARE and "z" not in text.lower():
        raise ValueError("too small a number without a unit: its end is missing")
    return found


def is_untold(text: str) -> bool:
    """True for an answer that says that there is none."""
    return text.strip().lower() in ("not available", "not installed")


def ranges_of(text: str) -> tuple[float, ...]:
    """Parse the list of a decoder's ranges, `5mm/s/V,10mm/s/V`, to m/s per V; none where it is not told.

    How the list is written was not found: numbers with their unit, with anything but a slash between them
    (estimate). Raises ValueError for no such list.
    """
    if is_untold(text):
        return ()
    parts = [part for part in re.split(r"[,;|\t]", text) if part.strip()]
    return tuple(scale_of(part) for part in parts)


def level_of(text: str) -> float:
    """Parse a signal level, 0 to 512, to a fraction of full light. Raises ValueError."""
    if not re.fullmatch(r"[0-9]{1,3}", text) or int(text) > LEVEL_FULL:
        raise ValueError(f"no level of 0 to {LEVEL_FULL}")
    return int(text) / LEVEL_FULL


def _quantity(text: str, unit: str, scales: dict[str, float], within: tuple[float, float]) -> float:
    # Firmware differs in blanks, "5 mm/s / V"; one within a number is damage.
    found = re.fullmatch(rf"\s*{_NUMBER}\s*{unit}\s*", text, re.ASCII)
    if found is None:
        raise ValueError("not a number with a known unit")
    value = float(found["number"]) * scales[(found["unit"] or "").lower()]
    low, high = within
    if not low <= value <= high:
        raise ValueError(f"not between {low:g} and {high:g} in SI units")
    return value


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
        self.scale, self.range = scale, scale * self._settings.full_scale

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
