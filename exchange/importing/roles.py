"""Which column a file itself says is the force, the time, ...: by a unit of this role only, or by name."""

from __future__ import annotations

import re
from collections.abc import Collection

import numpy as np

from ...instruments.arrays import FloatArray
from ..columns import Column, Table, unit_of
from .mapping import Role

_WORDS: dict[Role, str] = {
    "time": r"((elapsed ?)?time|zeit|temps|t|timestamps?|zeitstempel|datum|date|uhrzeit|x-axis|x_value|"
    r"micros|millis|seconds)\W*\Z|time\b|zeit\b",
    "force": r"(force|kraft|fz|f|load|last|load ?cell)(?![a-z0-9])",
    "acceleration": r"(acc|accel\w*|beschl\w*|a|az)(?![a-z0-9])",
    "displacement": r"(displacement|weg|travel|position|pos|hub|stroke|disp)(?![a-z0-9])",
    "activation": r"(activation|switch|schalter|taster|contact|kontakt|trigger|closed|sw)(?![a-z0-9])",
}
"""Headings that name a role."""
_VERTICAL = ("acceleration_z", "acceleration")
"""Of several accelerations, haploop's own vertical one."""
_NEAR = 0.1
"""Part of the way from one level to the other within which a signal is at a level."""


def columns_of(table: Table, role: Role, used: Collection[int]) -> tuple[list[int], str]:
    """The columns that the file says are this role, none of `used`, and by what it says so."""
    free = [(n, c) for n, c in enumerate(table.columns) if n not in used]
    if role == "time" and (stamps := [n for n, c in free if c.stamps]):
        return stamps[:1], "by its dates and times"
    named = [n for n, c in free if re.match(_WORDS[role], c.name, re.IGNORECASE)]
    if role == "activation":
        switching = [n for n, c in free if c.name and _unknown(c) and _two_levels(c.values)]
        called = [n for n in switching if n in named]
        return (called, "by its heading") if called else (switching, "the only column of two levels")
    measured = [n for n, c in free if (u := unit_of(c.unit)) is not None and u.quantity == role]
    both = [n for n in measured if n in named]
    own = [n for n in measured if table.columns[n].name in _VERTICAL]
    for found in (own[:1], measured, both):
        if len(found) == 1:
            return found, "by its heading and unit" if found[0] in both else "by its unit"
    if measured:
        return measured, "by its unit"
    other = [
        n for n in named if not _unknown(table.columns[n]) and unit_of(table.columns[n].unit) is not None
    ]
    return [n for n in named if n not in other or role == "force"], "by its heading"


def _unknown(column: Column) -> bool:
    """True for a column in volts, or in no unit of its own."""
    unit = unit_of(column.unit)
    return unit is None or unit.quantity == "voltage"


def _two_levels(values: FloatArray) -> bool:
    """True for a signal that is at one of two levels nearly all the time, and at both."""
    some = values[np.isfinite(values)]
    if len(some) < 3 or not np.ptp(some):
        return False
    share = (some - some.min()) / np.ptp(some)
    high = share > 1 - _NEAR
    between = np.mean((share >= _NEAR) & ~high)
    changes = np.count_nonzero(np.diff(high.astype(np.int8)))
    return bool(between < 0.02 and changes < 0.01 * len(some) + 3)
