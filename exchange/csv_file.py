"""Comma-separated values: units in the heading, `name [unit]`; numbers with nine digits."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TextIO

import numpy as np

from ..base.arrays import FloatArray
from ..base.files import new_file
from .views import Cell, PressTable, Responses, Signals, sidecar, write_json, write_sidecar


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


def _write(path: Path, headings: list[str], columns: FloatArray) -> None:
    with new_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerow(headings)
        # A point in every number: some readers tell a column's type by its first rows, where 0 is an integer.
        np.savetxt(file, columns, fmt="%#.9g", delimiter=",")
