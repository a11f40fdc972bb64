"""Rows of several measurements in one table, which a column of names or numbers tells apart: it is asked."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base.arrays import BoolArray
from ...base.errors import ConfigurationError
from ..columns import Labels, Table, is_blank
from .clock import rows_of
from .understood import Question

_NOTES = re.compile(
    r"(notes?|comments?|remarks?|kommentare?|bemerkung(en)?|memo|annotations?|judge(ment)?|verdict|alarm|marks?)"
    r"(?![a-z])",
    re.I,
)
"""Headings of what is said of single rows: it tells no measurements apart."""
_SPLITTERS = re.compile(
    r"(sensor|channel|node|device|trial|run|repetition|rep|cycle|session|block|segment|participant|subject|"
    r"person|proband|versuch|hand|finger|side|specimen|sample ?(id|no|number))"
    r"( ?(id|no\.?|nr\.?|number|name|index|#))?\s*\Z", re.I)  # fmt: skip
"""Headings of numbers that tell rows apart."""
_STROKES = re.compile(r"(down|up|press(ing|ed)?|releas(e|ing|ed)|(un)?load(ing)?|forward|back(ward)?|return)"
                      r"([ -]?stroke)?\Z", re.I)  # fmt: skip
"""The ways that one press goes: rows of both are one measurement."""
_ALL = "*"
_MOST = 64
"""Values of a column that tells rows apart."""
_SHOWN = 5


def split(table: Table, where: Mapping[str, str], told: Sequence[str | int]) -> tuple[Table, list[Question]]:
    """The rows that `where` names, and questions about columns that tell rows apart, none of `told`.

    Raises ConfigurationError for a column or a value that is not in the table.
    """
    known = {one.name: _continued(one) for one in table.labels}
    numbers = _numbers(table, where, told)
    kept = np.ones(len(table.columns[0].values), dtype=np.bool_)
    notes, questions = [], []
    for name, value in where.items():
        one = known.get(name) or numbers.get(name)
        if one is None:
            raise ConfigurationError(f"{table.path} has no column {name!r} that tells rows apart (--where).")
        there = np.array([value in (text, _ALL) for text in one.texts])
        if not there.any():
            raise ConfigurationError(f"{table.path} has no row with {name} {value!r}: it has {_shown(one)}.")
        kept &= there
        notes.append(f"Rows with {name} {value!r} were taken: {np.count_nonzero(there)} of {len(there)}.")
    for name, one in {**known, **numbers}.items():
        if name in where:
            continue
        if said := "" if name in numbers else _beside(one):
            notes.append(said)
            continue
        value = next(text for text in one.texts if not is_blank(text))
        option, each = (repr(one) if " " in one else one for one in (f"{name}={value}", name))
        questions.append(Question(
            f"where {name}", f"which rows are one measurement (column {name!r} has {_shown(one)}; * for all)",
            f"--where {option}, or --each {each}"))  # fmt: skip
    return _of_rows(replace(table, notes=(*table.notes, *notes)), kept), questions


def values_of(table: Table, name: str) -> tuple[tuple[str, ...], int]:
    """The values of a column that tells rows apart, in their order, and the number of rows without one.

    Raises ConfigurationError.
    """
    known = {one.name: _continued(one) for one in table.labels} | _numbers(table, {name: _ALL}, ())
    if name not in known:
        listed = ", ".join(sorted({one.name for one in table.labels})) or "no column of text"
        raise ConfigurationError(
            f"{table.path} has no column {name!r} that tells rows apart (it has {listed})."
        )
    texts = [text for text in known[name].texts if not is_blank(text)]
    found = tuple(dict.fromkeys(texts))
    if len(found) > _MOST:
        raise ConfigurationError(
            f"{table.path} has {len(found)} values of {name}, and up to {_MOST} measurements are told apart."
        )
    return found, len(known[name].texts) - len(texts)


def _continued(one: Labels) -> Labels:
    """Names of trials and the like that stand at the first row of each only, at all rows."""
    if not one.texts[0] or not _SPLITTERS.fullmatch(one.name):
        return one
    texts = list(one.texts)
    for row, text in enumerate(texts):
        texts[row] = text or texts[row - 1]
    return Labels(one.name, tuple(texts))


def _numbers(table: Table, where: Mapping[str, str], told: Sequence[str | int]) -> dict[str, Labels]:
    """Columns of few whole numbers that are called as what tells rows apart, or were told, as texts."""
    found = {}
    for number, column in enumerate(table.columns):
        if number in told or {column.name, column.heading, *column.also} & set(told):
            continue
        named = next((name for name in (column.name, column.heading) if name in where), None)
        called = _SPLITTERS.fullmatch(column.name.replace("_", " ")) and not column.unit
        finite = np.isfinite(column.values)
        distinct = np.unique(column.values[finite])
        several = len(distinct) + (not finite.all())
        if named or (called and not np.any(distinct % 1) and 1 < several <= _MOST):
            name = named or column.name
            # Six digits, unless two values are one then, as days are: 20261127 and 20261128.
            form = "g" if len({f"{value:g}" for value in distinct.tolist()}) == len(distinct) else ".15g"
            found[name] = Labels(name, tuple(f"{value:{form}}" for value in column.values.tolist()))
    return found


def _of_rows(table: Table, kept: BoolArray) -> Table:
    """The rows of a table that are kept."""
    if kept.all():
        return table
    columns = tuple(replace(column, values=column.values[kept]) for column in table.columns)
    place = np.cumsum(kept) - 1
    damaged = tuple(int(place[row]) for row in table.damaged if kept[row])
    starts = rows_of(table.starts, int(np.argmax(kept)))
    return replace(table, columns=columns, damaged=damaged, starts=starts)


def _beside(one: Labels) -> str:
    """The sentence on a column of text that tells no rows apart; "" for one that may."""
    there = [row for row, text in enumerate(one.texts) if not is_blank(text)]
    if not there:
        return f"{one.name} is empty ({one.texts[0]!r}), and was left out."
    distinct = {one.texts[row] for row in there}
    first = f"{one.texts[there[0]][:30]!r} in row {there[0] + 1}"
    if len(distinct) == 1 and len(there) == len(one.texts):
        return f"{one.name} is {one.texts[0][:30]!r} in all rows, and was left out."
    if all(map(_STROKES.match, distinct)) and len(there) == len(one.texts):
        return (
            f"{one.name} tells the ways of a press apart ({', '.join(sorted(distinct))}), all of which count."
        )
    if len(there) <= len(one.texts) / 2 or _NOTES.match(one.name) or len(distinct) > 0.9 * len(one.texts):
        return f"{one.name} is text ({first}), and was left out."
    return ""


def _shown(one: Labels) -> str:
    distinct = sorted({" ".join(text.split())[:40] for text in one.texts if not is_blank(text)})
    more = f" and {len(distinct) - _SHOWN} more" if len(distinct) > _SHOWN else ""
    return ", ".join(distinct[:_SHOWN]) + more
