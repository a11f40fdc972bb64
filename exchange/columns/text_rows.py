"""Rows of numbers in a text: separator, decimal sign, where they begin, and what stands above them.

A program writes a preamble, headings, units, and then rows of one shape until the end. The shape is taken
from rows in the middle of the file: separator and decimal sign are those with which they are numbers, dates
or blanks, in the most columns. Cells that are blank there are no columns. The body begins with the first of
ten rows of that shape. A comma that stands both in numbers and between them cannot be told: that is refused.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...instruments import DataError
from .stamps import is_stamp

_POINT = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?\s*\Z")
_COMMA = re.compile(r"\s*[-+]?(?:\d+,?\d*|,\d+)(?:[eEdD][-+]?\d+)?\s*\Z")
_BLANKS = {
    "",
    "-",
    "--",
    "nan",
    "na",
    "n/a",
    "#n/a",
    "#nv",
    "null",
    "none",
    "1.#qnan",
    "-1.#ind",
    "inf",
    "-inf",
}
_AMBIGUOUS = re.compile(r"[-+]?\d+,\d+\Z")
_SHAPES = (("\t", "."), ("\t", ","), (";", "."), (";", ","), (",", "."), ("|", "."), ("", "."), ("", ","))
"""Separator ("" for spaces) and decimal sign, the likelier first."""
_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", "": "spaces"}
_SEPARATORS = set("\t;|,")
_SAMPLE = 200
_RUN = 10


@dataclass(frozen=True)
class Body:
    """Where the rows of numbers are, and how their cells are told apart."""

    rows: Sequence[list[str]]
    """Every row of the file, as cells."""
    first: int
    """Number of the first row of the body."""
    end: int
    """Number of the row after the last."""
    columns: tuple[int, ...]
    """The cells of a row that are columns."""
    decimal: str
    shape: str
    """How it was read, for people."""


def decoded(path: Path) -> str:
    """Text in UTF-8, UTF-16 with its mark, or Windows-1252, as spreadsheets write. Raises DataError."""
    raw = path.read_bytes()
    try:
        if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return raw.decode("utf-16")
        if b"\0" in raw[:4096]:
            raise DataError(f"{path} is no text: say what it is (--from).")
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def is_blank(cell: str) -> bool:
    """True for a cell without a value."""
    return cell.strip().lower() in _BLANKS


def is_number(cell: str, decimal: str = ".") -> bool:
    """True for a number with this decimal sign."""
    return (_COMMA if decimal == "," else _POINT).match(cell) is not None


def body_of(path: Path, text: str, decimal: str | None = None) -> Body:
    """Find the rows of numbers in a text; `decimal` is the decimal sign, if it was told. Raises DataError."""
    lines = text.splitlines()
    filled = [line for line in lines if line.strip()]
    middle = len(filled) // 2
    sample = filled[middle : middle + _SAMPLE]
    shapes = [shape for shape in _SHAPES if decimal in (None, shape[1])]
    if not sample:
        raise DataError(f"{path} is empty.")
    found = max(((_fit(sample, *shape), -n, shape) for n, shape in enumerate(shapes)), default=None)
    if found is None or found[0] == (0, 0):
        raise DataError(
            f"{path} is no table of numbers: no row in its middle is one ({sample[0].strip()[:40]!r})."
        )
    separator, sign = found[2]
    named = any("," in line and re.search(r"[A-Za-z]{2}|[A-Za-z],", line) for line in filled[:_RUN])
    if separator == "," and not (decimal or named) and all(_AMBIGUOUS.match(line.strip()) for line in sample):
        raise DataError(
            f"{path} has rows like {sample[0].strip()[:30]!r}, which are a number with a decimal comma or "
            "two whole numbers: say which (--decimal , or --decimal .)."
        )
    rows = _split(lines, separator)
    shape = f"{_NAMES[separator]} between columns, decimal {'commas' if sign == ',' else 'points'}"
    return numeric_rows(path, rows, sign, shape)


def numeric_rows(path: Path, rows: Sequence[list[str]], decimal: str, shape: str) -> Body:
    """The body of rows of cells. Raises DataError when there is none."""
    filled = [row for row in rows if any(cell.strip() for cell in row)]
    middle = len(filled) // 2
    sample = filled[middle : middle + _SAMPLE]
    width = max(map(len, sample), default=0)
    columns = tuple(
        place
        for place in range(width)
        if any(place < len(row) and row[place].strip() for row in sample)
        and sum(place < len(row) and _value(row[place], decimal) for row in sample) >= 0.5 * len(sample)
    )
    if not columns:
        raise DataError(f"{path} is no table of numbers: no row in its middle is one.")
    need = min(_RUN, len(sample))
    run = first = 0
    for number, row in enumerate(rows):
        run = run + 1 if _is_row(row, columns, decimal) else 0
        if run == need:
            first = number - need + 1
            break
    else:
        raise DataError(
            f"{path} is no table of numbers: nowhere do {need} rows of {len(columns)} follow each other."
        )
    end = len(rows)
    while not _is_row(rows[end - 1], columns, decimal):  # blank lines, a footer, a line that was cut off
        end -= 1
    for number in range(first, end):
        if len(rows[number]) <= columns[-1]:
            raise DataError(stops(path, number, rows[number]))
    return Body(rows, first, end, columns, decimal, shape)


def _fit(sample: Sequence[str], separator: str, decimal: str) -> tuple[int, int]:
    """Rows of numbers under a shape, and the columns of these."""
    widths: dict[int, int] = {}
    for row in _split(sample, separator):
        if all(_value(cell, decimal) for cell in row) and any(is_number(cell, decimal) for cell in row):
            width = sum(not is_blank(cell) for cell in row)
            widths[width] = widths.get(width, 0) + 1
    # A blank in a row, or a column of text, makes no other shape.
    whole = sum(widths.values())
    if not whole:
        for row in _split(sample, separator):
            width = sum(is_number(cell, decimal) for cell in row)
            words = [cell for cell in row if not _value(cell, decimal)]
            if width > 1 and width >= len(words) and not any(_SEPARATORS & set(cell) for cell in words):
                widths[width] = widths.get(width, 0) + 1
        whole = sum(widths.values()) // 2
    return (whole, max(widths, key=widths.__getitem__)) if whole else (0, 0)


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    if not separator:
        return [line.split() for line in lines]
    if any('"' in line for line in lines):
        return [next(csv.reader([line], delimiter=separator), []) for line in lines]
    return [line.split(separator) for line in lines]


def _value(cell: str, decimal: str) -> bool:
    return is_number(cell, decimal) or is_blank(cell) or is_stamp(cell)


def _is_row(row: list[str], columns: tuple[int, ...], decimal: str) -> bool:
    if len(row) <= columns[-1]:
        return False
    cells = [row[place] for place in columns]
    return any(is_number(cell, decimal) for cell in cells) and all(_value(cell, decimal) for cell in cells)


def stops(path: Path, number: int, row: list[str]) -> str:
    """Sentence on a row amid others that is none."""
    said = " ".join(row).strip()[:40]
    return (
        f"{path} stops being a table in row {number + 1} ({said!r}): repair it, or import the part before it."
    )
