r"""The lines of Polytec's OFV-5000: text in, values out, no I/O. Driver and wire share it.

A command is `Get,DEVICE,INDEX,ATTRIBUTE`, `GetDevInfo,...` alike, or `Set,...,VALUE`; each line ends
with `\n`, and a Set is not answered (docs/hardware.md, "OFV-5000": as public code sends them). The forms
of the replies are from the same code, except where a function says that its form is an estimate.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, cast

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
