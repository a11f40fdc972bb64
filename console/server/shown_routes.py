"""What a file says, as JSON for its page, and its figures: the same `Contents` as in a report and a terminal.

A file is named as everywhere below the data folder; the rig's history of calibrations, which may lie
elsewhere, is asked for with `history=1`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any

from starlette.responses import Response

from ...base.errors import DataError
from ...experiments import export_answers
from ...reports.contents import Cell, Contents, Glance, Grid, unbroken
from ...reports.figures import encode, mark_simulated
from ...reports.html import contents_at, report_html
from ..data_folder import DataFolder, store_of

_TYPES = {"svg": "image/svg+xml", "png": "image/png", "pdf": "application/pdf", "csv": "text/csv"}

_DRAWING = Lock()
"""matplotlib draws in one thread at a time: its style and its parser of texts are the program's."""


def shown(data: DataFolder, asked: Mapping[str, str]) -> dict[str, Any]:
    """What a file says: title, glances, facts, tables, sentences, and the titles of its figures."""
    return contents_json(_contents(data, asked))


def figure(data: DataFolder, asked: Mapping[str, str]) -> Response:
    """One of a file's figures, by its number, `as` SVG, PNG, PDF, or CSV of what it draws."""
    contents, kind = _contents(data, asked), asked.get("as", "svg")
    number = asked.get("number", "0")
    if kind not in _TYPES or not number.isdecimal() or int(number) >= len(contents.figures):
        raise DataError("There is no such figure of this file: open its page again.")
    drawing = contents.figures[int(number)]
    with _DRAWING:
        drawn = drawing.draw(drawing.things, 2)
        if contents.simulated:
            mark_simulated(drawn)
        return Response(encode(drawn, kind), media_type=_TYPES[kind])


def night(data: DataFolder, asked: Mapping[str, str]) -> Response:
    """The report of a night, which `haploop recalibrate` wrote."""
    name = Path(asked.get("report", "")).name
    path = data.history.folder / "reports" / name
    if not name.endswith(".html") or not path.is_file():
        raise DataError(f"There is no report {name[:80]!r} of a night.")
    return Response(path.read_bytes(), media_type="text/html")


def report(data: DataFolder, asked: Mapping[str, str]) -> Response:
    """All that `haploop report` says of a file or a folder: one page of HTML, which needs no other."""
    return Response(report_html(data.path(asked.get("file", "")), _DRAWING), media_type="text/html")


def answers(data: DataFolder, asked: Mapping[str, str]) -> Response:
    """The answers of an experiment, as `haploop experiment export` writes them."""
    store = store_of(data, asked.get("experiment", ""))
    with TemporaryDirectory() as place:
        table = Path(place) / "answers.csv"
        export_answers(store, table)
        return Response(table.read_bytes(), media_type="text/csv")


def contents_json(contents: Contents) -> dict[str, Any]:
    """A result as JSON for a page: each cell is its text and its tone."""
    return {
        "title": contents.title,
        "simulated": bool(contents.simulated),
        "glances": [glance_json(one()) for one in contents.glances],
        "rows": [[label, _cell(cell)] for label, cell in contents.rows],
        "tables": [_grid(one) for one in contents.tables if one.rows],
        "said": [unbroken(one) for one in contents.said],
        "figures": [
            {
                "title": one.title,
                "caption": f"{one.caption} {one.count(one.things)}".strip(),
                "name": one.name,
            }
            for one in contents.figures
        ],
    }


def glance_json(glance: Glance) -> dict[str, Any]:
    """What the first screen of a report shows of one button, as a page draws it."""
    return {
        "title": glance.title,
        "verdict": _cell(glance.verdict),
        "strokes": glance.motion.strokes(),
        "ends": glance.motion.ends,
        "gauges": [{"label": one.label, "said": one.said, "marks": one.marks()} for one in glance.gauges],
        "sentence": glance.sentence,
    }


def _grid(grid: Grid) -> dict[str, Any]:
    return {
        "title": grid.title,
        "headings": [*grid.headings],
        "rows": [[_cell(cell) for cell in row] for row in grid.rows],
        "words": grid.words,
        "below": grid.below,
    }


def _cell(cell: str | Cell) -> dict[str, str]:
    found = cell if isinstance(cell, Cell) else Cell(cell, "")
    return {"text": unbroken(found.text), "tone": found.tone}


def _contents(data: DataFolder, asked: Mapping[str, str]) -> Contents:
    return contents_at(data.history.folder if asked.get("history") else data.path(asked.get("file", "")))
