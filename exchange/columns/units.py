"""Units as people write them, and what one of them is in SI."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ...instruments import ConfigurationError

SI = {"time": "s", "force": "N", "acceleration": "m/s^2", "displacement": "m", "voltage": "V"}
"""Unit of each quantity that a file's columns can have."""
_G = 9.80665


@dataclass(frozen=True)
class Unit:
    """A quantity, and how many SI units one of this unit is."""

    quantity: str
    factor: float


_KNOWN: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("s", "sec", "second", "seconds", "sekunden", "sek"), ("time", 1.0)),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds", "millis"), ("time", 1e-3)),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds", "micros"), ("time", 1e-6)),
    **dict.fromkeys(("ns", "nsec"), ("time", 1e-9)),
    **dict.fromkeys(("min", "minutes"), ("time", 60.0)),
    **dict.fromkeys(("n", "newton", "newtons"), ("force", 1.0)),
    **dict.fromkeys(("mn", "millinewton"), ("force", 1e-3)),
    "cn": ("force", 1e-2),
    "kn": ("force", 1e3),
    **dict.fromkeys(("gf", "gram-force", "grams-force"), ("force", 1e-3 * _G)),
    **dict.fromkeys(("kgf", "kp"), ("force", _G)),
    **dict.fromkeys(("lbf", "lbs", "lb"), ("force", 4.4482216152605)),
    **dict.fromkeys(("m/s^2", "m/s2", "m/s/s", "m/s**2", "ms-2", "ms^-2", "m/sec^2"), ("acceleration", 1.0)),
    **dict.fromkeys(("mm/s^2", "mm/s2"), ("acceleration", 1e-3)),
    **dict.fromkeys(("g", "gn", "g_n", "gs"), ("acceleration", _G)),
    "mg": ("acceleration", 1e-3 * _G),
    **dict.fromkeys(("m", "meter", "metre"), ("displacement", 1.0)),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), ("displacement", 1e-3)),
    **dict.fromkeys(("um", "micron", "microns", "micrometer"), ("displacement", 1e-6)),
    **dict.fromkeys(("in", "inch"), ("displacement", 0.0254)),
    **dict.fromkeys(("v", "volt", "volts", "vdc"), ("voltage", 1.0)),
    **dict.fromkeys(("mv", "millivolt", "millivolts"), ("voltage", 1e-3)),
    "uv": ("voltage", 1e-6),
}
_NUMBER = re.compile(r"\s*(?P<number>[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)?\s*(?P<unit>\D.*)?\s*\Z")
_BRACKETS = re.compile(r"\s*[\[(](?P<unit>[^\[\]]*)[\])]\Z")
_IN = re.compile(r"\s+in\s+(?P<unit>\S+)\Z")


def unit_of(text: str) -> Unit | None:
    """The unit that a text names; None for another text."""
    plain = text.strip().strip("[]").strip()
    if plain.startswith("(") and plain.endswith(")"):
        plain = plain[1:-1]
    plain = plain.translate({0xB5: "u", 0x3BC: "u", 0xB2: "^2", 0x20: None, 0xB7: None, 0x2F1: None})
    # Of upper and lower case only mega and milli differ, and nobody presses a button with meganewtons.
    known = None if plain in ("MN", "MV", "G", "MS") else _KNOWN.get(plain.lower())
    return None if known is None else Unit(*known)


def split_heading(heading: str) -> tuple[str, str]:
    """Name and unit in a heading: `Kraft [N]`, `a (g)`, `Weg/mm`, `Kraft in N`, `force_N`; "" without one."""
    heading = " ".join(heading.split()).strip("\"'")
    if match := _BRACKETS.search(heading[-200:]):
        cut = len(heading) - len(match[0])
        name, unit = heading[:cut].rstrip(" /"), match["unit"].strip()
        return (name, unit) if name else (heading, "")
    for sign in ("/", " in ", "_", ","):
        name, found, unit = heading.partition(sign) if sign == "/" else heading.rpartition(sign)
        if found and name.strip() and unit_of(unit) is not None:
            return name.strip(), unit.strip()
    return heading, ""


def per_unit(role: str, quantity: str, text: str, unit: str) -> tuple[float, str]:
    """SI units of `quantity` per unit of a column in `unit`, of which `text` says what it is; and the words.

    `text` is a unit (`mN`), what one of the file's units stands for (`40 N`), or a sensitivity (`100 mV/g`).
    Raises ConfigurationError.
    """
    match = _NUMBER.fullmatch(text)
    number = float(match["number"]) if match and match["number"] else 1.0
    named = ((match and match["unit"]) or "").strip()
    if not match or not named or not 1e-12 < number < 1e12:
        raise ConfigurationError(_unknown(role, quantity, text))
    whole = unit_of(named)
    if whole is not None and whole.quantity == quantity:
        return number * whole.factor, f"one of the file is {text.strip()}" if match[
            "number"
        ] else text.strip()
    for place in (k for k, sign in enumerate(named) if sign == "/"):
        above, below = unit_of(named[:place]), unit_of(named[place + 1 :])
        if above and below and above.quantity == "voltage" and below.quantity == quantity:
            own = unit_of(unit)
            if own is not None and own.quantity != "voltage":
                raise ConfigurationError(
                    f"The column of {role} is in {unit}, so it needs no sensitivity: leave {text!r} out."
                )
            per_volt = below.factor / (number * above.factor)
            return per_volt * (own or above).factor, f"{text.strip()}, of {unit or named[:place].strip()}"
    raise ConfigurationError(_unknown(role, quantity, text))


def _unknown(role: str, quantity: str, text: str) -> str:
    examples = {
        "force": "N, mN, '40 N' (what one of the file's units is) or '0.25 V/N'",
        "acceleration": "m/s^2, g, '9.81 m/s^2' (what one of the file's units is) or '100 mV/g'",
        "displacement": "mm, um or '2 V/mm'",
        "time": "s, ms or us",
    }
    return f"{text!r} is no unit of {role}: write {examples.get(quantity, 'a unit')}."
