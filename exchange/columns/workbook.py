"""Workbooks: the cells of a sheet as texts, with the unit that a cell's number format states.

A number format shows a cell in another form than it is kept in: `0.00" N"` adds a unit, `0.00%` multiplies by
a hundred, and a comma behind the digits divides by a thousand (ECMA-376 part 1, 18.8.31). What a sheet shows
under a heading is what it states, so the cell 0.02 in `0%` is "2 %". Runs in `contained`'s process.
"""

from __future__ import annotations

import re
from datetime import datetime, time
from functools import lru_cache
from pathlib import Path
from typing import Any

from ...base.entry_points import optional
from .units import units_of

MOST_COLUMNS = 1000
"""Columns of a table."""
_MOST_CELLS = 20_000_000
_PART = re.compile(
    r'"(?P<quoted>[^"]*)"|\\(?P<escaped>.)|\[\$(?P<currency>[^\]-]*)[^\]]*\]|\[[^\]]*\]|[_*].|'
    r"(?P<digits>General|[0#?](?:[0#?.,]*[0#?])?(?P<thousands>,*)(?:[eE][+-]0+)?)|(?P<end>;)|(?P<plain>.)"
)
_SHOWS_TIME = re.compile(r"[hs]", re.I)
"""In the number format of a date."""
"""Of a number format: literals, colours and conditions, blanks and fillers, digits, the next section."""


def read(path: Path) -> tuple[list[list[str]], str, list[str]]:
    """The rows and the name of the sheet with the most rows, and the names of others that have several.

    Raises ValueError for more columns or cells than a table of signals has, and for numbers that are shown
    in another size than they are kept in.
    """
    book = optional("openpyxl", "files", "A workbook").load_workbook(path, read_only=True, data_only=True)
    found: list[list[str]] = []
    name = ""
    sizes: dict[str, int] = {}
    odd: dict[str, str] = {}
    for sheet in book.worksheets:
        rows: list[list[str]] = []
        cells = 0
        title = str(sheet.title)
        for row in sheet.iter_rows():
            cells += len(row)
            if len(row) > MOST_COLUMNS or cells > _MOST_CELLS:
                raise ValueError(f"sheet {title!r} has over {MOST_COLUMNS} columns or {_MOST_CELLS} cells")
            try:
                rows.append([_text(cell) for cell in row])
            except ValueError as error:
                odd.setdefault(title, str(error))
        sizes[title] = len(rows)
        if len(rows) > len(found):
            found, name = rows, title
    if name in odd:
        raise ValueError(odd[name])
    return found, name, [one for one, rows in sizes.items() if rows > 2 and one != name]


def _text(cell: Any) -> str:
    value = cell.value
    if value is None:
        return ""
    if hasattr(value, "isoformat"):
        if not hasattr(value, "date"):
            return str(value.isoformat())
        day = value == datetime.combine(value, time()) and not _SHOWS_TIME.search(cell.number_format or "h")
        return str(value.date().isoformat() if day else value.isoformat(sep=" "))
    if isinstance(value, int | float) and not isinstance(value, bool):
        factor, unit = _shown(cell.number_format or "General")
        shown = value if factor == 1 else f"{factor * value:.15g}"
        return f"{shown!s} {unit}" if unit else repr(value)
    return str(value)


@lru_cache(maxsize=256)
def _shown(form: str) -> tuple[float, str]:
    """How much larger a number format shows a number than it is, and in which unit; "" without one.

    Raises ValueError for a size without a unit, and for units that depend on the number.
    """
    sections: list[tuple[float, str]] = []
    factor, literal, digits = 1.0, "", False
    for part in (*_PART.finditer(form), None):
        if part is None or part["end"]:
            unit = literal.strip()
            known = bool(units_of(unit))
            if digits:
                sections.append((100 * factor if "%" in unit else factor, unit if known else ""))
            factor, literal, digits = 1.0, "", False
        elif part["digits"]:
            factor, literal, digits = 1000.0 ** -len(part["thousands"] or ""), "", True
        else:
            literal += part["quoted"] or part["escaped"] or part["currency"] or part["plain"] or ""
    shown = set(sections) or {(1.0, "")}
    if len(shown) > 1:
        raise ValueError(f"its number format {form!r} shows several units: give the column one of them")
    (found,) = shown
    if found[0] != 1 and not found[1]:
        raise ValueError(
            f"its number format {form!r} shows numbers divided, without a unit that says so: give the column "
            "a format of the numbers that are meant"
        )
    return found
