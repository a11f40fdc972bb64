"""What a column says that it is: each is scored on its evidence and decided once.

Evidence is what the format says is measured, a unit of one quantity only, and a heading that names a role. A
unit that contradicts the heading is no evidence but a doubt, and asked about. That a column is the only one
left, takes few values, or stands first is evidence of nothing. Participant and button may be in the names of
files.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError
from ..columns import Column, read_table, units_of
from .splits import values_of
from .understood import MEASURED, ROLES, FileMapping, Role

_WORDS: Mapping[Role, str] = {
    "time": r"(((elapsed|relative|absolute|unix|epoch|sensor|posix)[ _]?)?(time(stamps?)?|epoch)|elapsed|t|"
    r"zeit|temps|unix|zeitstempel|datum|date|uhrzeit|x-axis|x_value|date[ &_/]*(and )?time)\W*\Z|time\b|"
    r"zeit\b|timestamp",
    "force": r"(force|kraft|fz|f|load|last|load ?cell)(?![a-z0-9])",
    "acceleration": r"((linear|user|raw|vertical)[ _]?)?(acc|accel\w*|beschl\w*|a|az)(?![a-z0-9])",
    "displacement": r"(displacement|weg|travel|position|pos|hub|stroke|disp)(?![a-z0-9])",
    "activation": r"(activation|switch|schalter|taster|contact|kontakt|closed|sw)(?![a-z0-9])",
}
"""Headings that name a role. A trigger is the recorder's as often as the button's."""
_SIDEWAYS: Mapping[Role, re.Pattern[str]] = {
    "acceleration": re.compile(
        r"(?<![a-z])(x|y|abs\w*|magnitude|mag|total|norm|resultant|sum|rms)(?![a-z])|"
        r"\A(acc\w*|a)[ _.]?[xy]\Z|\AaT\Z",
        re.I,
    ),
    "force": re.compile(r"\A(f|force|kraft|load)[ _.-]?[xy](?![a-z])", re.I),
}
"""Of accelerations and forces, those that are not said to be vertical."""
_SPAN = re.compile(
    r"(?<![a-z])(dt|delta|interval|diff\w*|duration|period|latency|delay|reaction)(?![a-z])", re.I
)
"""Headings of times that are no instants."""
_OWN = ("acceleration_z", "acceleration")
"""In haploop's own files, the vertical one."""
_NEAR = 0.1
"""Part of the way from one level to the other within which a signal is at a level."""


@dataclass(frozen=True)
class Claim:
    """That a column is a role."""

    score: int
    """How many things say so."""
    why: str
    doubt: str = ""
    """What speaks against it or its unit, for a question; "" without a doubt."""


def claim_of(column: Column, own: bool = False) -> tuple[Role, Claim] | None:
    """The role that a column's own evidence gives it; None without any. `own` of a file of haploop's."""
    if column.stamps:
        return "time", Claim(2, "by its dates and times")
    said = next((role for role in ROLES if role == column.quantity), None)
    units = {unit.quantity for unit in units_of(column.unit)}
    if said is not None:
        against = units and said not in units and "voltage" not in units
        doubt = f"it is said to be {said}, in {column.unit}" if against else ""
        return said, Claim(4 if own and column.name in _OWN else 3, "as the file says", doubt)
    named = [role for role in ROLES if re.match(_WORDS[role], column.name, re.IGNORECASE)]
    if _SPAN.search(column.name) and "time" in named:
        return None
    found = _by_both(column, named, units, own) if named else _by_unit(column, units)
    if found is not None and found[0] in _SIDEWAYS and _SIDEWAYS[found[0]].search(column.name):
        doubt = found[1].doubt or "its heading does not say that it is the vertical one"
        return found[0], replace(found[1], doubt=doubt)
    return found


def _by_both(column: Column, named: Sequence[Role], units: Set[str], own: bool) -> tuple[Role, Claim] | None:
    """What a heading that names a role and a unit give together."""
    both = next((role for role in named if role in units), None)
    if both is not None:
        return both, Claim(3 if own and column.name in _OWN else 2, "by its heading and unit")
    if "mass" in units and "force" in named:
        return "force", Claim(1, "by its heading", _mass(column))
    if not units or "voltage" in units:
        return named[0], Claim(1, "by its heading")
    if named[0] in MEASURED and (units & set(ROLES) or len(column.name) > 1):
        doubt = f"its heading says {named[0]}, its unit {column.unit} does not"
        return named[0], Claim(1, "by its heading", doubt)
    return _by_unit(column, units)


def _by_unit(column: Column, units: Set[str]) -> tuple[Role, Claim] | None:
    """What a unit gives alone: the role of the only quantity that it is of."""
    measured = [role for role in ROLES if role in units]
    if "time" in units and _SPAN.search(column.name):
        return None
    if "mass" in units:
        if measured:
            return measured[0], Claim(1, "by its unit", f"{column.unit} may be gravity or grams")
        return "force", Claim(1, "by its unit, a scale's", _mass(column))
    return (measured[0], Claim(1, "by its unit")) if len(measured) == 1 else None


def _mass(column: Column) -> str:
    return f"force or mass? {column.unit} is of both"


def is_switching(values: FloatArray) -> bool:
    """True for a signal that is at one of two levels nearly all the time, and at both."""
    some = values[np.isfinite(values)]
    if len(some) < 3 or not np.ptp(some):
        return False
    share = (some - some.min()) / np.ptp(some)
    high = share > 1 - _NEAR
    between = np.mean((share >= _NEAR) & ~high)
    changes = np.count_nonzero(np.diff(high.astype(np.int8)))
    return bool(between < 0.02 and changes < 0.01 * len(some) + 3)


_PARTS = {"participant": r"(?P<participant>[A-Za-z]{1,4}[0-9]{1,4})", "button": r"(?P<button>[A-Za-z0-9-]+?)"}


def each_of(
    path: Path, mapping: FileMapping, column: str, say: Callable[[str], object] = lambda _: None
) -> dict[str, FileMapping]:
    """By a name for its file: the mapping of each measurement that a column of a table tells apart.

    A column of participants or buttons says who pressed what. `say` is given a sentence on rows of none.
    Raises ConfigurationError and DataError.
    """
    mapping = named(path, mapping).model_copy(update={"names": None})
    table = read_table(path, mapping.format, mapping.decimal, mapping.skip_damaged)
    found: dict[str, FileMapping] = {}
    values, without = values_of(table, column)
    if without:
        say(f"{path} has {without} rows without a value of {column}, which are of no measurement: left out.")
    names = set()
    for value in values:
        told: dict[str, Any] = {"where": {**mapping.where, column: value}}
        if column.lower() in ("participant", "button"):
            told[column.lower()] = value
        name = f"{path.stem}-{re.sub(r'[^A-Za-z0-9_.-]+', '_', value)}"
        if name.casefold() in names:  # Windows and macOS have one file of both
            raise ConfigurationError(f"{path} has two values of {column} that would be one file, {name}.h5.")
        names.add(name.casefold())
        found[name] = mapping.model_copy(update=told)
    return found


def named(path: Path, mapping: FileMapping) -> FileMapping:
    """The mapping with what a file's name says by its pattern `names`. Raises ConfigurationError."""
    if mapping.names is None:
        return mapping
    pattern = re.escape(mapping.names).replace(r"\*", ".*?")
    for part, regex in _PARTS.items():
        pattern = pattern.replace(rf"\{{{part}\}}", regex, 1)
    match = re.fullmatch(pattern, path.stem)
    if match is None:
        raise ConfigurationError(
            f"{path.name} is not named as {mapping.names!r}: name it so, or leave the names out and state "
            "--participant and --button."
        )
    return mapping.model_copy(update=match.groupdict())
