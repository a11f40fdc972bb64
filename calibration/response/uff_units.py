"""What an ordinate of data set 58 is, and in which unit: type, label and data set 164 read together.

The type (record 9, field 1) names the quantity, the label (field 6) a unit, and data set 164 the unit of a
length and of a force in the whole file, by which programs convert. A file may leave away any of the three.
Two that are there must agree: of a g under SI factors nobody can tell which one the numbers follow.

Source: SDRC's universal data sets 58 and 164, https://www.ceas3.uc.edu/sdrluff/.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

LENGTH, VELOCITY, ACCELERATION, FORCE, VOLTAGE = "m", "m/s", "m/s^2", "N", "V"
_QUANTITIES = {8: LENGTH, 9: FORCE, 11: VELOCITY, 12: ACCELERATION, 13: FORCE}
"""SI unit by specific data type; types 0 and 1 name none."""
_NAMED = {8: "displacement", 9: "reaction force", 11: "velocity", 12: "acceleration", 13: "excitation force"}
_OPEN = (0, 1)
_G = 9.80665
_LENGTHS = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "nm": 1e-9,
    "in": 0.0254,
    "inch": 0.0254,
    "ft": 0.3048,
}
_OTHERS = {
    **dict.fromkeys(("g", "gn", "g_n", "g's", "gs"), (ACCELERATION, _G)),
    "mg": (ACCELERATION, 1e-3 * _G),
    **dict.fromkeys(("n", "newton", "newtons"), (FORCE, 1.0)),
    "mn": (FORCE, 1e-3), "cn": (FORCE, 1e-2), "kn": (FORCE, 1e3),
    "kgf": (FORCE, _G), "gf": (FORCE, 1e-3 * _G),
    **dict.fromkeys(("lbf", "lb"), (FORCE, 4.4482216152605)),
    **dict.fromkeys(("v", "volt", "volts"), (VOLTAGE, 1.0)),
    "mv": (VOLTAGE, 1e-3),
}  # fmt: skip
_SPEEDS = {"": LENGTH, "/s": VELOCITY, "/s^2": ACCELERATION}
_SAME = {
    "/sec": "/s",
    "/s/s": "/s^2",
    "/s2": "/s^2",
    "s^-2": "/s^2",
    "s-2": "/s^2",
    "s^-1": "/s",
    "s-1": "/s",
}
_PER = re.compile(r"(?P<above>.+)/(?P<below>[^/()]+)\Z")


@dataclass(frozen=True)
class Ordinate:
    """Unit of an ordinate: `si` names the quantity, and one of the file is `factor` of it."""

    si: str
    """ "m", "m/s", "m/s^2", "N" or "V"; "" for another quantity, or where the file names none."""
    factor: float
    """NaN where the file does not say."""
    label: str
    """As in the file."""
    doubt: str = ""
    """Both sides of a contradiction, or what is not stated."""


def ordinate_of(
    function: Mapping[str, Any], units: Mapping[str, Any] | None, side: str = "ordinate"
) -> Ordinate:
    """Unit of a function's ordinate (or `side` "orddenom", its denominator); `units` is data set 164."""
    kind = int(function.get(f"{side}_spec_data_type", 0))
    label = str(function.get(f"{side}_axis_units_lab", "")).strip()
    label = "" if label.upper() == "NONE" else label
    return _ordinate(kind, label, units)


def response_of(function: Mapping[str, Any], units: Mapping[str, Any] | None) -> tuple[Ordinate, Ordinate]:
    """Units of a frequency response: of what moved, and of its reference, which one label may hold both."""
    above, below = ordinate_of(function, units), ordinate_of(function, units, "orddenom")
    match = _PER.fullmatch(above.label.replace(" ", ""))
    if not below.si and match and named_unit(above.label) is None and (per := named_unit(match["below"])):
        kind = int(function.get("ordinate_spec_data_type", 0))
        return _ordinate(kind, match["above"], units), Ordinate(*per, match["below"])
    return above, below


def per_unit(label: str) -> tuple[tuple[str, float], tuple[str, float]] | None:
    """What a label like `(mm/s)/V` has above and below its last stroke; None where it does not name both."""
    match = _PER.fullmatch(label.replace(" ", ""))
    above, below = (named_unit(match["above"]), named_unit(match["below"])) if match else (None, None)
    return (above, below) if above and below else None


def named_unit(label: str) -> tuple[str, float] | None:
    """SI unit, and how much of it one of a label's unit is; None for another text."""
    plain = label.translate(
        {0xB5: "u", 0x3BC: "u", 0xB2: "^2", 0x20: None, 0xB7: None, 0x2A: "^", 0x2E: None}
    )
    plain = plain.replace("^^", "^").strip("[]")
    if plain in ("G", "MN", "MV"):
        return None
    plain = plain.lower()
    while plain.startswith("(") and plain.endswith(")"):
        plain = plain[1:-1]
    if plain in _OTHERS:
        return _OTHERS[plain]
    for length, factor in _LENGTHS.items():
        rest = plain.removeprefix(length)
        rest = _SAME.get(rest.replace("sec", "s"), rest.replace("sec", "s"))
        if plain.startswith(length) and rest in _SPEEDS:
            return _SPEEDS[rest], factor
    return None


def _ordinate(kind: int, label: str, units: Mapping[str, Any] | None) -> Ordinate:
    si, own, none = _QUANTITIES.get(kind, ""), named_unit(label), float("nan")
    if not si:
        doubt = "" if own else f"its type ({kind}) and its label ({label!r}) name no unit"
        return Ordinate(*(own if own and kind in _OPEN else ("", none)), label, doubt)
    stated = None if units is None else 1 / float(units["force" if si == FORCE else "length"] or "nan")
    if own is not None and own[0] != si:
        doubt = f"its type is {_NAMED[kind]}, and its label says {label!r}"
    elif own is None and label:
        doubt = f"its label {label!r} is no unit of {_NAMED[kind]}"
    elif own is not None and stated is not None and abs(own[1] / stated - 1) > 1e-3:
        doubt = f"its label says {label!r}, and data set 164 a unit of {stated:.6g} {si}"
    elif own is not None:
        return Ordinate(si, own[1], label)
    elif stated is not None:
        return Ordinate(si, stated, _in_words(si, stated))
    else:
        doubt = "neither a label nor data set 164 names its unit"
    return Ordinate(si, none, label, doubt)


def _in_words(si: str, factor: float) -> str:
    """A label for `factor` of an SI unit; "" for one without a name."""
    names = (
        {name: own for name, (quantity, own) in _OTHERS.items() if quantity == si}
        if si == FORCE
        else _LENGTHS
    )
    found = next((name for name, own in names.items() if abs(own / factor - 1) < 1e-6), "")
    return {"n": "N", "mn": "mN", "cn": "cN", "kn": "kN"}.get(found, found) + (
        si[1:] if found and si != FORCE else ""
    )
