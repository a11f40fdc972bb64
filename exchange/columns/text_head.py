"""What stands above the rows of a text: headings, units, names and steps by channel."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import tzinfo
from itertools import zip_longest
from pathlib import Path

from ...base.errors import DataError
from .start_times import order_of, zones_of
from .text_cells import is_blank, is_number, plain_number
from .text_rates import is_stamp
from .text_rows import Body
from .units import factor_in, is_factor, is_time, split_heading, unit_of, units_of

_MARKS = "#%;/!\"' "
"""Signs of a comment, before a line of headings."""
_LESS = ("comment", "comments", "kommentar")
"""Headings of LabVIEW's that have no column."""
_KEYS = {
    "names": r"trace ?name|channel ?names?|labels?|ch\w* labels?|signal ?names?|names?|headers?",
    "units": r"y_unit_label|vertical units?|[vy] ?units?|units?|einheit(en)?",
    "horizontal": r"horizontal units?|[hx] ?units?|x_unit_label|time ?units?|axis ?units?",
    "dimension": r"x_dimension",
    "offset": r"h ?offset|x0",
    "scale": r"vertical scale|volts? ?(/|per) ?div(ision)?",
}
_ASIDE = ("units", "horizontal", "scale")
"""Keys that may stand beside the numbers."""
_KEY = {
    what: re.compile(rf"(?:{key})\s*(?:(?::=|[=:])\s*(?P<first>.*))?\Z", re.I) for what, key in _KEYS.items()
}
_RULE = re.compile(r"[-=_*~+#]{2,}\Z")
"""A line drawn below headings."""
_WORD = re.compile(r"[A-Za-z][a-z]{4,}")
"""In brackets behind a name, of what no unit is: `(Trigger)`, `(filtered)`."""
_NO_UNIT = re.compile(r"no[ _]units?|unitless|dimensionless|none|-+", re.I)


@dataclass
class Head:
    """What is stated above the rows, by place of a column."""

    names: dict[int, str] = field(default_factory=dict)
    units: dict[int, str] = field(default_factory=dict)
    doubts: dict[int, str] = field(default_factory=dict)
    also: dict[int, tuple[str, ...]] = field(default_factory=dict)
    """The heading as it stands there, and other names."""
    starts: dict[int, float] = field(default_factory=dict)
    divisions: dict[int, float] = field(default_factory=dict)
    """What a division of an oscilloscope's screen is, in the column's unit."""
    seconds: float | None = None
    """The unit of the horizontal axis, where it is stated."""
    labview: bool = False
    """True for LabVIEW's text of a measurement."""
    order: str = ""
    """What stands first in dates, the day or the month ("d", "m"), where the file gives their form."""
    zone: tzinfo | None = None
    """The time zone that the file states of its times."""
    notes: list[str] = field(default_factory=list)


def head_of(path: Path, body: Body, above: Sequence[list[str]]) -> Head:
    """What the rows above a body state. Raises DataError for headings that cannot be told apart."""
    head = Head()
    filled = [row for row in above if not all(not cell or _RULE.match(cell) for cell in row)]
    keyed = {what: cells for what, cells in map(_keyed, beside(body)) if what in _ASIDE}
    free: list[list[str]] = []
    for row in filled:
        what, cells = _keyed(row)
        if what:
            keyed[what] = cells
        free.append([] if what else row)
    for said in (*keyed.get("dimension", ()), *keyed.get("horizontal", ())):
        if said.lower().startswith("freq") or unit_of(said, "rate"):
            raise DataError(f"{path} states an axis of {said}: it is over frequency, and holds no signals.")
    if filled and filled[0][0].startswith("LabVIEW Measurement"):
        head.labview, head.seconds = True, 1.0  # its axis of time is in seconds by definition
    head.order, head.zone = order_of(filled), zones_of(filled)[1]
    # A row of keys stands above the headings, or takes their place.
    rows = free[max((n for n, row in enumerate(free) if not row), default=-1) + 1 :] if keyed else free
    _headings(path, body, head, rows, filled)
    for place, label in _placed(body, head, keyed.get("names", [])).items():
        name = head.names.get(place, "")
        head.names[place] = f"{label} {name}".strip()
        head.also[place] = (name, *head.also.get(place, ()))
    for place, unit in _united(body, head, keyed).items():
        enter_unit(head, place, unit, "the row of units")
    for place, scale in _placed(body, head, keyed.get("scale", []), "horizontal" in keyed).items():
        if is_number(scale, body.decimal):
            head.divisions[place] = float(plain_number(scale, body.decimal))
    _axis(body, head, keyed)
    _factors(body, head, filled)
    return head


def _united(body: Body, head: Head, keyed: Mapping[str, list[str]]) -> dict[int, str]:
    """The units of a row of keys by column: of all that are measured, where it has one only."""
    cells = keyed.get("units", [])
    found = _placed(body, head, cells, "horizontal" in keyed)
    if len(cells) != 1 or found or not head.names:
        return found
    return {n: cells[0] for n in body.columns if not is_time(head.names.get(n, ""), head.units.get(n, ""))}


def beside(body: Body) -> list[list[str]]:
    """Cells that stand beside the columns: an old oscilloscope's preamble, a start and an increment."""
    places = set(body.columns)
    return [
        [cell.strip() for place, cell in enumerate(row) if place not in places and cell.strip()]
        for row in body.rows[:40]
    ]


def _factors(body: Body, head: Head, rows: Sequence[Sequence[str]]) -> None:
    """Doubt the columns that factors stand above: each of a row, those that the line names, or all."""
    headings = {cell for cells in head.also.values() for cell in cells}
    for row, below in zip_longest(rows, rows[1:], fillvalue=()):
        cells = [cell for cell in row if cell not in headings]
        key, values = next(iter(cells), ""), cells[1:]
        each: Mapping[int, str] = {}
        if len(values) > 1 and is_factor(key) and all(is_number(cell, body.decimal) for cell in values):
            each = {place: f"{key} {cell}" for place, cell in _placed(body, head, values).items()}
        under = [
            f"{cell} {value}" for cell, value in zip(row, below, strict=False)
            if is_factor(cell) and is_number(value, body.decimal)
        ]  # fmt: skip
        for line in () if each else (" ".join(cells), *under):
            places = [place for place in body.columns if _names(line, head.names.get(place, ""))]
            each = {**each, **dict.fromkeys(places or body.columns, line)}
        for place, line in each.items():
            found = factor_in(line)
            if found and found.pure and not is_time(head.names.get(place, ""), head.units.get(place, "")):
                head.doubts.setdefault(place, found.doubt)
            elif found and not found.pure:
                note = f"{found.words!r} is stated, and was not applied: units are as the headings say."
                head.notes += [] if note in head.notes else [note]


def _names(line: str, name: str) -> bool:
    return bool(name) and re.search(rf"(?<!\w){re.escape(name)}(?!\w)", line, re.I) is not None


def _axis(body: Body, head: Head, keyed: Mapping[str, list[str]]) -> None:
    """The unit and the start of the horizontal axis, and the column that it is."""
    if keyed.get("horizontal"):
        axis = unit_of(keyed["horizontal"][0], "time")
        head.seconds = axis.factor if axis else None
        first = body.columns[0]
        if len(keyed.get("units", ())) == len(body.columns) - 1 and first not in head.units:
            head.units[first] = keyed["horizontal"][0]
    for place in body.columns:
        if head.seconds is not None and _is_named(head, place, "x_value"):
            head.units.setdefault(place, "s")
    for place, text in _placed(body, head, keyed.get("offset", [])).items():
        if is_number(text, body.decimal) and head.seconds is not None:
            head.starts[place] = head.seconds * float(text.replace(",", "."))


def _keyed(row: list[str]) -> tuple[str, list[str]]:
    """What a row says of each channel, by the key that it begins with; "" for another row."""
    first = row[0].strip(_MARKS) if row else ""
    for what, key in _KEY.items():
        if (match := key.match(first)) is not None:
            cells = [*([match["first"]] if match["first"] else []), *row[1:]]
            cells = [re.sub(r"^\w+:\s*", "", cell.strip(" \"'")) for cell in cells]  # CH1:V
            while cells and not cells[-1]:
                cells.pop()
            return (what, cells) if cells and all(cells) else ("", [])
    return "", []


def _placed(body: Body, head: Head, cells: Sequence[str], axis: bool = False) -> dict[int, str]:
    """Cells of a row of keys by the columns that they are of; none where their number fits none.

    `axis` where the first column is known to be the horizontal axis.
    """
    columns = body.columns
    measured = [place for place in columns if not _is_named(head, place, "x_value")]
    for places in (columns, measured, columns[1:] if axis or columns[0] == 0 else ()):
        if len(places) == len(cells):
            return dict(zip(places, cells, strict=True))
    return {}


def _is_named(head: Head, place: int, name: str) -> bool:
    return head.names.get(place, "").lower() == name


def _headings(
    path: Path, body: Body, head: Head, rows: Sequence[list[str]], filled: Sequence[list[str]]
) -> None:
    """Names and units of the last rows above the body: names, or names and below them units or more names."""
    levels = [_shaped(row, body) for row in rows[-3:]]
    index: dict[int, str] = {}
    if len(levels) > 1 and rows[-1] and (only := _of_index(rows[-1], body)) and levels[-2]:
        index, levels = only, levels[:-1]  # pandas: names of the index, below the headings
    if units := _unit_row(levels, body):
        levels = levels[:-1]
    last, over = (levels[-1] if levels else None), (levels[-2] if len(levels) > 1 else None)
    if last is None or (not units and not _are_names(last, body)):
        _tell_unnamed(path, body, head, rows, filled)
        return
    join = not units and over is not None and _are_names(over, body) and _continues(rows, body)
    for place, cell in {**last, **index}.items():
        name, unit = split_heading(cell)
        head.also[place] = (cell,)
        if join and over is not None and over[place] not in ("", cell):
            upper, above = split_heading(over[place])
            head.also[place] = (name, cell)
            name, unit = f"{upper} {name}".strip(), unit or above
        head.names[place] = name
        if unit:
            head.units[place] = unit
    for place, unit in units.items():
        enter_unit(head, place, unit, "the row of units")


def _unit_row(levels: Sequence[dict[int, str] | None], body: Body) -> dict[int, str]:
    """Units by place, where the last row is one of units and the one above it may be one of names."""
    last, over = (levels[-1], levels[-2]) if len(levels) > 1 else (None, None)
    if not last or over is None or any(re.search(r"\d[.]\d|[:=]", cell) for cell in over.values()):
        return {}
    if not _are_units([last[place] for place in body.columns]):
        return {}
    return {n: cell.strip("()[] ") for n, cell in last.items() if cell and not _NO_UNIT.fullmatch(cell)}


def _tell_unnamed(
    path: Path, body: Body, head: Head, rows: Sequence[list[str]], filled: Sequence[list[str]]
) -> None:
    """Note that the line above the rows names no columns; raise DataError where it may, by other commas."""
    row = [cell for cell in (rows[-1] if rows else []) if cell]
    wide = len(body.columns)
    if body.shape.startswith("commas") and 2 <= len(row) == len(rows[-1]) < wide <= 2 * len(row):
        raise DataError(
            f"{path} has {len(row)} headings over {wide} columns: where commas stand both in numbers and "
            "between them, they cannot be told apart, so export it with semicolons or tabs."
        )
    if row and len(filled) and filled[-1] == rows[-1]:
        said = " ".join(row)[:40]
        head.notes.append(
            f"The line above the rows ({said!r}) does not name {wide} columns, and was left out."
        )


def _continues(rows: Sequence[list[str]], body: Body) -> bool:
    """True for two rows of headings as pandas writes them: of one width, and nothing else."""
    told = any(re.search(r"[:=]|\A\d", cell) for row in rows for cell in row)
    return len(body.columns) > 1 and len(rows) in (2, 3) and len(rows[-1]) == len(rows[-2]) and not told


def enter_unit(head: Head, place: int, unit: str, where: str) -> None:
    """Enter a unit; where another one is stated, neither holds. Words in brackets are a part of the name."""
    before = head.units.get(place, "")
    if _WORD.fullmatch(before) and not units_of(before) and units_of(unit):
        head.names[place] = head.also.get(place, (head.names.get(place, ""),))[-1]
    elif before and units_of(before) != units_of(unit):
        head.doubts[place] = f"its heading says {before}, {where} {unit}"
    head.units[place] = unit


def _of_index(row: list[str], body: Body) -> dict[int, str]:
    """The only cell of a row that has one for each column, and no other filled."""
    there = {place: cell for place, cell in enumerate(row) if cell}
    fits = len(row) > body.columns[-1] > 0 and set(there) == {0} and 0 in body.columns
    return there if fits and not is_number(there[0]) else {}


def _are_names(cells: dict[int, str], body: Body) -> bool:
    texts = [cells[place] for place in body.columns if cells[place]]
    return bool(texts) and not any(
        is_number(cell, body.decimal) or is_stamp(cell) or (is_blank(cell) and cell) or " = " in cell
        for cell in texts
    )  # fmt: skip


def _shaped(row: list[str], body: Body) -> dict[int, str] | None:
    """The cells of a row above the columns; None when it has not as many."""
    cells = list(row)
    if cells and cells[0][:1] in tuple("#%;"):
        rest = cells[0].lstrip(_MARKS)
        cells = [rest, *cells[1:]] if rest else cells[1:]
    width = max(body.columns[-1] + 1, len(body.rows[0]) if len(body.rows) else 0)
    while cells and (not cells[-1] or cells[-1].lower() in _LESS) and len(cells) > width:
        cells.pop()
    # Between spaces, a heading of two words would shift those behind it.
    if len(cells) <= body.columns[-1] or (body.shape.startswith("spaces") and len(cells) > width):
        return None
    found = {place: cells[place] for place in range(len(cells)) if place in body.columns or cells[place]}
    named = [found[place] for place in body.columns]
    # The first may have none: pandas writes the numbers of rows under an empty heading. Of units, any may.
    half = 2 * sum(map(bool, named)) >= len(named) and _are_units(named)
    return found if all(named[1:] if len(named) > 1 else named) or half else None


def _are_units(cells: Sequence[str]) -> bool:
    found = [cell for cell in cells if cell and not _NO_UNIT.fullmatch(cell)]
    known = [bool(units_of(cell)) or (cell[0] in "([" and cell[-1] in ")]") for cell in found]
    return bool(found) and known.count(True) * 2 > len(found) and not any(map(is_number, found))
