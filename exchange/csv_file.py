"""Comma-separated values: units in the heading, `name [unit]`; numbers with nine digits."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ..acquisition.presses import write_rows
from ..base.arrays import FloatArray
from ..base.files import new_file
from .views import PressTable, Responses, Signals, sidecar, write_json, write_sidecar


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


def _write(path: Path, headings: list[str], columns: FloatArray) -> None:
    with new_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerow(headings)
        # A point in every number: some readers tell a column's type by its first rows, where 0 is an integer.
        np.savetxt(file, columns, fmt="%#.9g", delimiter=",")
