"""Text files: CSV and its relatives, of spreadsheets, LabVIEW, Dewesoft, oscilloscopes and loggers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...instruments import DataError
from ...instruments.arrays import FloatArray
from ..views import read_sidecar
from .stamps import is_stamp, seconds_of
from .table import Column, Table
from .text_rows import Body, body_of, decoded, is_blank, is_number, stops
from .units import split_heading, unit_of

_MARKS = "#%;/!\"' "
"""Signs of a comment, before a line of headings."""
_LESS = ("comment", "comments", "kommentar")
"""Headings of LabVIEW's that have no column."""
_UNITS = re.compile(r"(y_unit_label|vertical units?|units?|einheit(en)?)\W*\Z", re.I)
_RATE = re.compile(
    r"\b(sampl\w*[ _-]*(rate|freq\w*)|samplerate|abtast(rate|frequenz)|rate|fs)\b\D{0,12}?[\s:=;,]\s*"
    r"(?P<number>\d[\d.,]*(?:[eE][-+]?\d+)?)\s*(?P<unit>[a-zA-Z/]*)", re.I)  # fmt: skip
_STEP = re.compile(
    r"\b(sampl\w*[ _-]*(interval|period)|delta_?x|increment|abtastintervall|abtastperiode|dt|x_?incr\w*)"
    r"\b[^\d]{0,12}?[\s:=;,]\s*(?P<number>\d[\d.,]*(?:[eE][-+]?\d+)?)\s*(?P<unit>[a-zA-Zµμ]*)",
    re.I)  # fmt: skip
_LABELLED = re.compile(r"([A-Za-z]\w*):\s*([-+]?\d+\.?\d*(?:[eE][-+]?\d+)?)(?=[\s,;]|\Z)")
_PER = {"khz": 1e3, "ks/s": 1e3, "mhz": 1e6, "ms/s": 1e6}


def read_table(path: Path, decimal: str | None) -> Table:
    """Read a file's columns; `decimal` is the decimal sign, if it was told. Raises DataError."""
    try:
        text = _without_labels(decoded(path))
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}.") from None
    return replace(table_of(path, body_of(path, text, decimal)), about=read_sidecar(path).get("about", {}))


def _without_labels(text: str) -> str:
    """A text of `label:value` pairs, as for Arduino's plotter, as columns under their labels."""
    lines = [line for line in text.splitlines() if line.strip()]
    pairs = [_LABELLED.findall(line) for line in lines]
    middle = len(lines) // 2
    labels = [label for label, _ in pairs[middle]] if lines else []
    if not labels or _LABELLED.sub("", lines[middle]).strip(" ,;\t"):
        return text
    rows = ["\t".join(value for _, value in one) for one in pairs if [label for label, _ in one] == labels]
    return "\n".join(["\t".join(labels), *rows])


def table_of(path: Path, body: Body) -> Table:
    """The columns of rows, with what the rows above them say. Raises DataError."""
    above = [[cell.strip() for cell in row] for row in body.rows[: body.first]]
    headings, units, notes = _headings(path, body, above)
    rate, rate_from = _stated_rate([*above, *_beside(body)], body.decimal)
    values = _values(path, body)
    columns = []
    for place, column, stamps in values:
        name, unit = headings.get(place, ("", ""))
        columns.append(Column(name, "" if stamps else units.get(place, unit), column, stamps=stamps))
    columns = _one_stamp(columns)
    lines = f", the first row of numbers is line {body.first + 1}" if body.first else ", no headings"
    return Table(path, body.shape + lines, tuple(columns), rate, rate_from, notes=tuple(notes))


def _headings(
    path: Path, body: Body, above: Sequence[list[str]]
) -> tuple[Mapping[int, tuple[str, str]], Mapping[int, str], list[str]]:
    """Name and unit by column, units of a row of their own, and what else is to be said."""
    filled = [row for row in above if any(row)]
    own: dict[int, str] = {}
    for row in filled:  # a row that is called units
        if row and _UNITS.match(row[0].lstrip(_MARKS)):
            own = {place: row[place] for place in body.columns if place < len(row) and row[place]}
            own.pop(0, None)
        if row and row[0].lower() == "horizontal units" and len(row) > 1:
            time = row[1]
            own = {body.columns[0]: time} | own
    if not filled:
        return {}, own, []
    last = _shaped(filled[-1], body)
    if len(filled) > 1 and last and _are_units(last.values()):
        own |= {place: cell.strip("()[] ") for place, cell in last.items() if cell}
        last = _shaped(filled[-2], body)
    elif last and any(is_number(cell, body.decimal) or is_stamp(cell) for cell in last.values()):
        last = None
    if last is None:
        row = [cell for cell in filled[-1] if cell]
        wide = len(body.columns)
        if body.shape.startswith("commas") and 2 <= len(row) < wide <= 2 * len(row):
            raise DataError(
                f"{path} has {len(row)} headings over {wide} columns: where commas stand both in numbers and "
                "between them, they cannot be told apart, so export it with semicolons or tabs."
            )
        said = " ".join(row)[:40]
        return (
            {},
            own,
            [f"The line above the rows ({said!r}) does not name {wide} columns, and was left out."],
        )
    return {place: split_heading(cell) for place, cell in last.items()}, own, []


def _shaped(row: list[str], body: Body) -> dict[int, str] | None:
    """The cells of a row above the columns; None when it has not as many."""
    cells = list(row)
    if cells and cells[0][:1] in tuple("#%;"):
        rest = cells[0].lstrip(_MARKS)
        cells = [rest, *cells[1:]] if rest else cells[1:]
    while cells and (not cells[-1] or cells[-1].lower() in _LESS) and len(cells) - 1 > body.columns[-1]:
        cells.pop()
    if len(cells) <= body.columns[-1]:
        return None
    found = {place: cells[place] for place in body.columns}
    # The first may have none: pandas writes the numbers of rows under an empty heading.
    named = list(found.values())[1:] if len(found) > 2 else list(found.values())
    return found if all(named) else None


def _are_units(cells: object) -> bool:
    found = [cell for cell in cells if cell] if hasattr(cells, "__iter__") else []
    known = [unit_of(cell) is not None or (cell[0] in "([" and cell[-1] in ")]") for cell in found]
    return bool(found) and known.count(True) * 2 > len(found) and not any(map(is_number, found))


def _beside(body: Body) -> list[list[str]]:
    """Cells that stand beside the columns: an old oscilloscope's preamble, a start and an increment."""
    places = set(body.columns)
    found = []
    for row in body.rows[body.first : body.first + 40]:
        found.append([cell for place, cell in enumerate(row) if place not in places and cell.strip()])
    return found


def _stated_rate(rows: Sequence[list[str]], decimal: str) -> tuple[float | None, str]:
    """Samples per second that rows above the columns state, and the words of it."""
    for number, row in enumerate(rows):
        line = " : ".join(cell for cell in row if cell)
        if match := _RATE.search(line):
            value = _number(match["number"], decimal)
            if value > 0:
                return value * _PER.get(match["unit"].lower(), 1.0), match[0].replace(" : ", " ").strip()
        if match := _STEP.search(line):
            value = _number(match["number"], decimal)
            unit = unit_of(match["unit"] or "s")
            if value > 0:
                factor = unit.factor if unit is not None and unit.quantity == "time" else 1.0
                return float(f"{1 / (value * factor):.9g}"), match[0].replace(" : ", " ").strip()
        for place, cell in enumerate(row):  # a heading with its value below it
            below = rows[number + 1] if number + 1 < len(rows) else []
            if cell.lower() == "increment" and place < len(below) and is_number(below[place]):
                value = _number(below[place], decimal)
                if value > 0:
                    return float(f"{1 / value:.9g}"), f"increment {below[place]}"
    return None, ""


def _number(text: str, decimal: str) -> float:
    try:
        return float(text.replace(",", ".") if decimal == "," else text.replace(",", ""))
    except ValueError:
        return 0.0


def _values(path: Path, body: Body) -> list[tuple[int, FloatArray, bool]]:
    """Place, (rows,) values, and whether they are stamps, of each column."""
    rows = body.rows[body.first : body.end]
    found = []
    for place in body.columns:
        cells = [row[place] for row in rows]
        if is_stamp(cells[0]) and not is_number(cells[0], body.decimal):
            found.append((place, seconds_of(cells), True))
            continue
        if body.decimal == ",":
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            values = np.array(cells, dtype=np.float64)
        except ValueError:
            values = np.array([_cell(path, body, row, cell) for row, cell in enumerate(cells)])
        values[~np.isfinite(values)] = np.nan
        found.append((place, values, False))
    if not rows:
        raise DataError(f"{path} has no row of numbers.")
    return found


def _cell(path: Path, body: Body, row: int, cell: str) -> float:
    """The number in a cell, NaN for a blank one. Raises DataError for anything else."""
    if is_blank(cell):
        return float("nan")
    if not is_number(cell):
        raise DataError(stops(path, body.first + row, body.rows[body.first + row]))
    return float(cell.replace("D", "E").replace("d", "e"))


def _one_stamp(columns: list[Column]) -> list[Column]:
    """Of a date and a time of day in a column each, the time of day: it counts on at midnight."""
    stamps = [column for column in columns if column.stamps]
    if len(stamps) < 2:
        return columns
    finest = max(stamps, key=lambda column: len(np.unique(column.values)))
    name = " ".join(column.name for column in stamps).strip()
    rest = [column for column in columns if not column.stamps]
    return [Column(name, "", finest.values, stamps=True), *rest]
