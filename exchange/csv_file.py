"""Comma-separated values: units in the heading, `name [unit]`; numbers with nine digits."""

from __future__ import annotations

import codecs
import csv
import io
import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from ..instruments import DataError
from ..instruments.arrays import FloatArray
from ..instruments.files import new_file
from .views import (
    Cell,
    Channel,
    PressTable,
    Responses,
    Signals,
    even_rate,
    read_sidecar,
    sidecar,
    write_json,
    write_sidecar,
)

__all__ = ["read_signals", "write_presses", "write_responses", "write_rows", "write_signals"]

_UNIT = re.compile(r"[\[(](?P<unit>[^\[(\])]*)[\])]$")
_SECONDS = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "min": 60.0}


def write_signals(signals: Signals, path: Path) -> None:
    """One row a sample, the time first; a sidecar keeps the origin."""
    headings = ["time [s]", *(f"{c.name} [{c.unit}]" for c in signals.channels)]
    columns = np.stack([signals.time, *(c.values for c in signals.channels)], axis=1)
    write_sidecar(path, signals)
    _write(path, headings, columns)


def write_responses(found: Responses, path: Path) -> None:
    """One row a line: frequency, then real part, imaginary part and coherence of each response.

    A sidecar keeps the origin, and of a map the row and column of each point.
    """
    headings, columns = ["frequency [Hz]"], [found.responses[0].frequencies]
    for response in found.responses:
        name = f"patch {response.patch} point {response.point}"
        headings += [f"{name} velocity real [(m/s)/V]", f"{name} velocity imaginary [(m/s)/V]"]
        columns += [response.velocity.real, response.velocity.imag]
        if len(response.coherence):
            headings.append(f"{name} coherence [1]")
            columns.append(response.coherence)
    cells = (
        [{}] * len(found.responses)
        if found.grid is None
        else [{"row": int(row), "column": int(column)} for row, column in found.grid]
    )
    places = [
        {"patch": r.patch, "point": r.point} | cell for r, cell in zip(found.responses, cells, strict=True)
    ]
    write_json(sidecar(path), {"title": found.title, "responses": places, "about": dict(found.about)})
    _write(path, headings, np.stack(columns, axis=1))


def write_presses(table: PressTable, path: Path) -> None:
    """One row a press; an unknown value is an empty cell."""
    with new_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        write_rows(file, table.units, table.rows)


def write_rows(
    file: TextIO, columns: Iterable[str], rows: Iterable[Mapping[str, Cell]], headings: bool = True
) -> None:
    """Write rows into an open file (newline=""), with a line of headings before them or without."""
    writer = csv.DictWriter(file, list(columns))
    if headings:
        writer.writeheader()
    for row in rows:
        writer.writerow({name: _cell(value) for name, value in row.items()})


def _cell(value: Cell) -> Cell:
    """A text that a spreadsheet would take for a formula gets an apostrophe before it."""
    if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return f"'{value}"
    return "" if value is None else value


def read_signals(path: Path, rate_hz: float | None) -> Signals:
    """Read columns of numbers under one row of headings; the column `time` or `t` gives the rate.

    Separators are comma, or semicolon or tab, between which a comma is a decimal one (a spreadsheet's in most
    of Europe). `rate_hz` is needed without a column of time. Raises DataError.
    """
    try:
        lines = io.StringIO(_text(path), newline=None)
        first = lines.readline()
        separator = max(",;\t", key=first.count)
        headings = next(csv.reader([first], delimiter=separator), [])
        rows = lines if separator == "," else (line.replace(",", ".") for line in lines)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty file: refused below
            values = np.loadtxt(rows, delimiter=separator, ndmin=2)
    except ValueError as error:
        said = str(error).rstrip(".")
        raise DataError(f"{path} is no table of numbers under one row of headings ({said}).") from None
    if not len(values) or values.shape[1] != len(headings):
        raise DataError(f"{path} has {len(headings)} headings, and its rows do not have as many numbers.")
    channels = []
    for heading, column in zip(map(str.strip, headings), values.T, strict=True):
        match = _UNIT.search(heading)
        name, unit = (heading[: match.start()].strip(), match["unit"].strip()) if match else (heading, "")
        if name.lower() in ("time", "t"):
            if unit not in _SECONDS:
                raise DataError(f"{path} gives its time in {unit!r}: give it in {', '.join(_SECONDS)[2:]}.")
            rate_hz = even_rate(path, column * _SECONDS[unit])
        elif name.lower() == "frequency":
            raise DataError(f"{path} is over frequency: of responses haploop imports .uff files only.")
        else:
            channels.append(Channel(name, unit, np.asarray(column)))
    if rate_hz is None:
        raise DataError(f"{path} has no column of time: state its sample rate (--rate).")
    if not channels:
        raise DataError(f"{path} has no column beside the time.")
    beside = read_sidecar(path)
    return Signals(path.stem, rate_hz, tuple(channels), channels[0].name, beside.get("about", {}))


def _text(path: Path) -> str:
    """Text in UTF-8, UTF-16 with its mark, or Windows-1252, as spreadsheets write. Raises ValueError."""
    raw = path.read_bytes()
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252")


def _write(path: Path, headings: list[str], columns: FloatArray) -> None:
    with new_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerow(headings)
        # A point in every number: some readers tell a column's type by its first rows, where 0 is an integer.
        np.savetxt(file, columns, fmt="%#.9g", delimiter=",")
