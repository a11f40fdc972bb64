r"""The lines of Polytec's OFV-5000: text in, values out, no I/O. Driver and wire share it.

A command is `Get,DEVICE,INDEX,ATTRIBUTE`, `GetDevInfo,...` alike, or `Set,...,VALUE`; each line ends
with `\n`, and a Set is not answered (docs/hardware.md, "OFV-5000": as public code sends them). The forms
of the replies are from the same code, except where a function says that its form is an estimate.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, cast

__all__ = [
    "LEVEL_FULL",
    "Command",
    "duration_of",
    "frequency_of",
    "is_command",
    "level_of",
    "scale_of",
    "scale_text",
]

Verb = Literal["Get", "Set", "GetDevInfo"]

LEVEL_FULL = 512
"""Signal level of full light (found for VibroFlex, Polytec's newer controller; docs/hardware.md,
"OFV-5000")."""

_NUMBER = r"(?P<number>\d+(?:\.\d*)?|\.\d+)"
_VELOCITY = {"um": 1e-6, "µm": 1e-6, "mm": 1e-3, "m": 1.0}
_TIME = {"ns": 1e-9, "us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "": 1e-6}
_FREQUENCY = {"hz": 1.0, "khz": 1e3, "mhz": 1e6}
_SENSITIVITIES = (1e-6, 10.0)
"""Valid scales (m/s per V); like the two below, wider than any product's: beyond is a garbled line."""
_DELAYS = (0.0, 0.1)
_FREQUENCIES = (1.0, 1e9)


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
    return _quantity(text, r"(?P<unit>[uµ]m|mm|m)/s/V", _VELOCITY, _SENSITIVITIES)


def scale_text(scale: float) -> str:
    """Format a scale (m/s per V) as the controller names its ranges, in mm/s/V."""
    return f"{scale * 1e3:.6g}mm/s/V"


def duration_of(text: str) -> float:
    """Parse a signal delay, `12.3 us`, to seconds. Raises ValueError.

    Public code reads only the number; microseconds for a bare number are an estimate.
    """
    return _quantity(text, r"(?P<unit>[nuµm]?s)?", _TIME, _DELAYS)


def frequency_of(text: str) -> float | None:
    """Parse a highest frequency, `20 kHz`, to Hz; None for `Not Available`. Raises ValueError."""
    if text.strip().lower() == "not available":
        return None
    return _quantity(text, r"(?P<unit>[kKmM]?[hH][zZ])", _FREQUENCY, _FREQUENCIES)


def level_of(text: str) -> float:
    """Parse a signal level, 0 to 512, to a fraction of full light. Raises ValueError."""
    if not re.fullmatch(r"[0-9]{1,3}", text) or int(text) > LEVEL_FULL:
        raise ValueError(f"no level of 0 to {LEVEL_FULL}")
    return int(text) / LEVEL_FULL


def _quantity(text: str, unit: str, scales: dict[str, float], within: tuple[float, float]) -> float:
    found = re.fullmatch(rf"{_NUMBER}\s*{unit}", text.strip(), re.ASCII)
    if found is None:
        raise ValueError("not a number with a known unit")
    value = float(found["number"]) * scales[(found["unit"] or "").lower()]
    low, high = within
    if not low <= value <= high:
        raise ValueError(f"not between {low:g} and {high:g} in SI units")
    return value
