"""Rows of numbers in a text: separator, decimal sign, where they begin, and what stands above them.

A program writes a preamble, headings, units, and then rows of one shape until the end. The shape is taken
from rows in the middle of the file: separator and decimal sign are those with which they are numbers, dates
or blanks, in the most columns. A column is one of numbers when most of its cells that are not blank are;
others are text. The body begins with the first of ten rows of that shape. A row that is none is damaged:
refused, or left out where that was told, and then its place is kept. A comma that stands both in numbers and
between them cannot be told: that is refused.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import DataError
from .text_cells import is_blank, is_number, measured
from .text_rates import is_stamp

_OTHER = re.compile(r"[-+]?\d[\d.]*,\d+|[-+]?\d+\.\d+")
_AMBIGUOUS = re.compile(r"[-+]?\d+,\d+\Z")
_CLOCK = re.compile(r"(?<!\d)(\d{1,2}:\d{2}:\d{3}|\d{1,2}:\d{2}:\d{2}[:;]\d{2})(?!\d)")
"""Milliseconds behind minutes, or behind hours; frames, of a rate that nothing states."""
_BRACKETED = re.compile(r"\s*\(\d+[.,]\d+\)\s*\Z")
"""Accountants' negative, or an uncertainty."""
_SHAPES = (
    ("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", "."), ("|", "."), ("", "."), ("", ","),
    (",", ","),
)  # fmt: skip
"""Separator ("" for spaces) and decimal sign, the likelier first; the last one in quotes only."""
_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", "": "spaces"}
_SPACED = re.compile(r'"[^"]*"|\S+')
_SEPARATORS = set("\t;|,")
_SAMPLE = 200
_RUN = 10
_WIDEST = 4096
"""Columns of a text; a press has a dozen."""
_USUAL = 64
"""Columns of a text beyond which there are more rows."""
_TORN = 0.1
"""Share of rows that may be damaged."""


@dataclass(frozen=True, eq=False)
class Body:
    """Where the rows of numbers are, and how their cells are told apart."""

    above: Sequence[list[str]]
    """The rows before the body, as cells."""
    rows: Sequence[list[str]]
    """The rows of the body, as cells; without any where `values` holds them."""
    columns: tuple[int, ...]
    """The cells of a row that are numbers, dates or times."""
    decimal: str
    shape: str
    """How it was read, for people."""
    values: FloatArray | None = None
    """(rows, columns), where all cells are numbers."""
    damaged: tuple[int, ...] = ()
    """Numbers of rows, from 0 at the body's first, that were left out; their cells are blank."""
    notes: tuple[str, ...] = ()


def body_of(path: Path, text: str, decimal: str | None = None, skip: bool = False) -> Body:
    """Find the rows of numbers in a text; `decimal` is the decimal sign, if it was told.

    Rows that are damaged are left out where `skip` says so. Raises DataError.
    """
    lines = text.splitlines()
    filled = [line for line in lines if line.strip()]
    _bounded(path, filled)
    middle = len(filled) // 2
    sample = filled[middle : middle + _SAMPLE]
    quoted = '"' in text
    shapes = [shape for shape in _SHAPES[: None if quoted else -1] if decimal in (None, shape[1])]
    if not sample:
        raise DataError(f"{path} is empty.")
    # Dates have spaces in them: these are what stands between columns where no sign is.
    fits = [(_fit(sample, *shape), -n, shape) for n, shape in enumerate(shapes)]
    found = max(fits, default=None, key=lambda fit: (fit[0][0], fit[2][0] != "", fit[0][1], fit[1]))
    if found is None or found[0] == (0, 0):
        what = f"{path} is no table of numbers: no row in its middle is one ({sample[0].strip()[:40]!r})."
        clock = _CLOCK.search(sample[0])
        raise DataError(f"{what} Write {clock[0]} as hh:mm:ss.mmm, or in seconds." if clock else what)
    separator, sign = found[2]
    named = any("," in line and re.search(r"[A-Za-z]{2}|[A-Za-z],", line) for line in filled[:_RUN])
    if separator == "," and not (decimal or named) and all(_AMBIGUOUS.match(line.strip()) for line in sample):
        raise DataError(
            f"{path} has rows like {sample[0].strip()[:30]!r}, which are a number with a decimal comma or "
            "two whole numbers: say which (--decimal , or --decimal .)."
        )
    shape = f"{_NAMES[separator]} between columns, decimal {'commas' if sign == ',' else 'points'}"
    body = None if quoted else _at_once(lines, sample, separator, sign, shape)
    if body is None:
        body = numeric_rows(path, _split(lines, separator), sign, shape, skip)
    rows = len(body.rows) or len(body.values if body.values is not None else ())
    if 4 * rows < len(body.columns) > _USUAL:
        raise DataError(
            f"{path} has {rows} rows of {len(body.columns)} numbers: samples stand below each other, so turn "
            "the table."
        )
    return body if text.endswith(("\n", "\r")) else _uncut(body, filled[-_SAMPLE:], separator)


def _bounded(path: Path, lines: Sequence[str]) -> None:
    """Raise DataError for a row with more cells than any table has, before it is split."""
    for line in lines:
        if len(line) > _WIDEST:
            most = max(line.count(s) for s in "\t;|,")
            if max(most, len(line.split(None, _WIDEST + 1)) - 1) >= _WIDEST:
                raise DataError(
                    f"{path} has a row of more than {_WIDEST} cells: samples stand below each other, so turn "
                    "the table."
                )


def _at_once(
    lines: Sequence[str], sample: Sequence[str], separator: str, sign: str, shape: str
) -> Body | None:
    """The body of a text whose cells are all numbers, read by NumPy; None for any other."""
    cells = _split(sample, separator)
    widths = {len(row) for row in cells}
    width = max(widths)
    if len(widths) > 1 or not all(is_number(cell, sign) for row in cells for cell in row):
        return None
    columns = tuple(range(width))
    need = min(_RUN, len(sample))
    each = (_split([line], separator)[0] for line in lines)
    whole = (len(row) == width and all(is_number(cell, sign) for cell in row) for row in each)
    if (first := _first_run(whole, need)) is None:
        return None
    end = len(lines)
    while end and not lines[end - 1].strip():
        end -= 1
    block = lines[first:end]
    above = _split(lines[:first], separator)
    if not all(map(str.strip, block)) or _begins_earlier(above, columns, sign):
        return None
    try:
        values = np.loadtxt(
            block if sign == "." else [line.replace(",", ".") for line in block],
            delimiter=separator or None, comments=None, ndmin=2, dtype=np.float64,
        )  # fmt: skip
    except ValueError:
        return None
    return Body(above, (), columns, sign, shape, values) if values.shape[1] == width else None


def numeric_rows(path: Path, rows: Sequence[list[str]], decimal: str, shape: str, skip: bool = False) -> Body:
    """The body of rows of cells, without damaged ones if `skip`. Raises DataError for those, and for none."""
    if max(map(len, rows), default=0) > _WIDEST:
        raise DataError(f"{path} has a row of more than {_WIDEST} cells: samples stand below each other.")
    filled = [row for row in rows if _is_filled(row)]
    middle = len(filled) // 2
    sample = filled[middle : middle + _SAMPLE]
    columns = _columns(sample, decimal)
    if not columns:
        raise DataError(f"{path} is no table of numbers: no row in its middle is one.")
    _refuse_brackets(path, rows, columns)
    first, end = _extent(path, rows, columns, decimal, min(_RUN, len(sample)))
    above, within, below = rows[:first], rows[first:end], rows[end:]
    usual = Counter(len(_stripped(row)) for row in sample).most_common(1)[0][0]
    widest = max(usual, columns[-1] + 1, *map(len, above[-2:]), 0)
    bad = [
        number
        for number, row in enumerate(within, first)
        if not _is_row(row, columns, decimal) or len(_stripped(row)) > widest
    ]
    notes = []
    if bad:
        _refuse_damaged(path, rows, bad, len(within), decimal, skip)
        notes.append(f"Damaged and left out: {_said(bad, rows)}. Where they stood, nothing was measured.")
    if after := [row for row in below if _is_filled(row)]:
        notes.append(f"What follows the last row ({' '.join(after[0]).strip()[:40]!r}) was left out.")
    gone, width = set(bad), max(map(len, within))
    kept = [[] if number in gone else row for number, row in enumerate(within, first)]
    whole = [row + [""] * (width - len(row)) for row in kept]
    places = tuple(sorted({*columns, *_sparse(whole, columns, decimal)}))
    return Body(
        above, whole, places, decimal, shape, damaged=tuple(n - first for n in bad), notes=tuple(notes)
    )


def _refuse_brackets(path: Path, rows: Sequence[list[str]], columns: tuple[int, ...]) -> None:
    closed = (row[place] for row in rows for place in columns if place < len(row) and "(" in row[place])
    if bracketed := next(filter(_BRACKETED.match, closed), None):
        raise DataError(
            f"{path} has numbers in brackets, like {bracketed.strip()}, which accountants write for negative "
            "ones: give them their signs."
        )


def _extent(
    path: Path, rows: Sequence[list[str]], columns: tuple[int, ...], decimal: str, need: int
) -> tuple[int, int]:
    """Where the body begins and ends. Raises DataError where no `need` rows follow each other."""
    first = _first_run((_is_row(row, columns, decimal) for row in rows), need)
    if first is None:
        raise DataError(
            f"{path} is no table of numbers: nowhere do {need} rows of {len(columns)} follow each other."
        )
    end = len(rows)
    while not _is_row(rows[end - 1], columns, decimal):  # blank lines, a footer, a line that was cut off
        end -= 1
    return first - _begins_earlier(rows[:first], columns, decimal), end


def _refuse_damaged(
    path: Path, rows: Sequence[list[str]], bad: Sequence[int], of: int, decimal: str, skip: bool
) -> None:
    """Raise DataError for rows that are no numbers, unless `skip`, they are few, and none has other signs."""
    # A number with another decimal sign, or thousands, is not damaged.
    other = any(_OTHER.fullmatch(c.strip()) for n in bad for c in rows[n] if not is_number(c, decimal))
    if skip and not other and len(bad) <= _TORN * of:
        return
    if skip or other:
        raise DataError(
            f"{path} has {len(bad)} rows that are no few damaged ones: {_said(bad, rows)}. Look "
            "at the decimal sign of its numbers."
        )
    said = " ".join(rows[bad[0]]).strip()[:40]
    more = f", and so do {len(bad) - 1} more rows" if len(bad) > 1 else ""
    raise DataError(
        f"{path} stops being a table in row {bad[0] + 1} ({said!r}){more}: repair it, or leave such rows out "
        "as gaps (--skip-damaged)."
    )


def _sparse(rows: Sequence[list[str]], columns: tuple[int, ...], decimal: str) -> Iterator[int]:
    """Places at which most rows are blank, and all others have numbers, dates or times."""
    for place in set(range(len(rows[0]))) - set(columns):
        cells = [row[place] for row in rows if not is_blank(row[place])]
        if len(cells) > _SAMPLE and all(_value(cell, decimal) for cell in cells):
            yield place


def _is_filled(row: Sequence[str]) -> bool:
    return any(cell.strip() for cell in row)


def _first_run(flags: Iterable[bool], need: int) -> int | None:
    """The number of the first of `need` true flags in a row; None without such."""
    run = 0
    for number, flag in enumerate(flags):
        run = run + 1 if flag else 0
        if run == need:
            return number - need + 1
    return None


def _columns(sample: Sequence[list[str]], decimal: str) -> tuple[int, ...]:
    """Places at which most cells that are not blank are numbers, dates or times."""
    found = []
    for place in range(max(map(len, sample), default=0)):
        cells = [row[place] for row in sample if place < len(row) and not is_blank(row[place])]
        if cells and sum(_value(cell, decimal) for cell in cells) >= 0.5 * len(cells):
            found.append(place)
    return tuple(found)


def _begins_earlier(above: Sequence[list[str]], columns: tuple[int, ...], decimal: str) -> int:
    """How many rows before the first run of rows the body begins: a damaged row may stand near its start."""
    earlier = 0
    for back, row in enumerate(reversed(above[-_RUN:]), 1):
        cells = _stripped(row)
        if _is_row(row, columns, decimal) and len(cells) >= columns[-1] + 1:
            earlier = back
        elif len(cells) >= len(columns) and not any(is_number(cell, decimal) for cell in cells):
            break  # headings, or units
    return earlier


def _uncut(body: Body, lines: Sequence[str], separator: str) -> Body:
    """The body of a text whose last line has no end, without its last row where that is cut in a number."""
    *before, row = (_stripped([cell.strip() for cell in one]) for one in _split(lines, separator))
    place = body.columns[-1]
    others = [one[place] for one in before if len(one) == place + 1 and is_number(one[place], body.decimal)]
    if len(row) != place + 1 or len(others) < 3 or not is_number(row[place], body.decimal):
        return body
    fewest = min(_decimals(other, body.decimal) for other in others)
    if len(row[place]) >= min(map(len, others)) and _decimals(row[place], body.decimal) >= fewest:
        return body
    note = f"The last line ends in {row[place]!r}, cut in the middle of a number, and was left out."
    return replace(
        body, rows=body.rows[:-1], values=None if body.values is None else body.values[:-1],
        notes=(*body.notes, note),
    )  # fmt: skip


def _decimals(cell: str, decimal: str) -> int:
    return len(cell.partition(decimal)[2])


def _fit(sample: Sequence[str], separator: str, decimal: str) -> tuple[int, int]:
    """Rows of numbers under a shape, and the columns of these."""
    widths: dict[int, int] = {}
    rows = _split(sample, separator)
    for row in rows:
        if all(_value(cell, decimal) for cell in row) and any(_has_number(cell, decimal) for cell in row):
            width = sum(not is_blank(cell) for cell in row)
            widths[width] = widths.get(width, 0) + 1
    # A blank in a row, or a column of text, makes no other shape.
    whole = sum(widths.values())
    if whole < 0.5 * len(rows):  # `898MA` in a column of names is a number with its unit
        for line, row in zip(sample, rows, strict=True):
            width = sum(_has_number(cell, decimal) or is_stamp(cell) for cell in row)
            words = [cell for cell in row if not _value(cell, decimal)]
            apart = '"' in line or not any(_SEPARATORS & set(cell) for cell in words)
            if words and width > 1 and apart and any(_has_number(cell, decimal) for cell in row):
                widths[width] = widths.get(width, 0) + 1
        whole = (whole + sum(widths.values())) // 2
    return (whole, max(widths, key=widths.__getitem__)) if whole else (0, 0)


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    if not separator:
        return [[cell.strip('"') for cell in _SPACED.findall(line)] for line in lines]
    if any('"' in line for line in lines):
        return [next(csv.reader([line], delimiter=separator), []) for line in lines]
    return [line.split(separator) for line in lines]


def _stripped(row: list[str]) -> list[str]:
    """A row without blank cells at its end."""
    end = len(row)
    while end and not row[end - 1].strip():
        end -= 1
    return row[:end]


def _value(cell: str, decimal: str) -> bool:
    return is_blank(cell) or is_stamp(cell) or _has_number(cell, decimal)


def _has_number(cell: str, decimal: str) -> bool:
    return is_number(cell, decimal) or measured(cell, decimal) is not None


def _is_row(row: list[str], columns: tuple[int, ...], decimal: str) -> bool:
    if len(row) <= columns[-1]:
        return False
    cells = [row[place] for place in columns]
    return any(_has_number(cell, decimal) for cell in cells) and all(_value(cell, decimal) for cell in cells)


def _said(bad: Sequence[int], rows: Sequence[list[str]]) -> str:
    some = ", ".join(f"row {n + 1} ({' '.join(rows[n]).strip()[:30]!r})" for n in bad[:3])
    return f"{some} and {len(bad) - 3} more" if len(bad) > 3 else some
