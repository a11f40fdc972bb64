"""What a file says, as JSON for its page, its figures, and a digital button's verdicts and waveforms.

A file is named as everywhere below the data folder; the rig's history of calibrations, which may lie
elsewhere, is asked for with `history=1`.
"""

from __future__ import annotations

import glob
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any

import numpy as np
from starlette.responses import Response

from ...acquisition import Representative
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...calibration import Check, DigitalButton, Drive, check_feeling
from ...calibration.drive import activation_time
from ...calibration.spectra import resample, third_octaves
from ...experiments import export_answers
from ...reports.contents import (
    Cell,
    Contents,
    Glance,
    Grid,
    check_glance,
    crosstalk_facts,
    one_style,
    other_facts,
    silence_facts,
    text_of,
    unbroken,
)
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


# A digital button as JSON: verdicts, waveforms and spectra of a check, at the point that is looked at.

_SHOWN_HZ = 5000.0
"""Samples per second of the waveforms of a check that are sent."""


def button_shown(data: DataFolder, asked: Mapping[str, str]) -> Any:
    """A digital button with its own check, or another check of it: waveforms, spectra, levels.

    `point` is that of the button that is looked at, where several are played at once.
    """
    path = data.path(asked.get("file", ""))
    button = DigitalButton.load(path)
    whole = Check.load(data.path(asked["check"])) if asked.get("check") else button.check
    check, press = _seen(button, whole, asked.get("point", ""))
    feeling = check_feeling(check, press)
    drive = check.drive
    recorded = _recorded(press, check)
    low, high = check.octaves.hz[0], check.octaves.hz[-1]
    begin, end = _loud(check.target)
    step = max(1, round(check.rate_hz / _SHOWN_HZ))
    at = _times(begin, end, step, check.rate_hz)
    drives = {p: np.round(np.interp(at, _clock(drive), own), 3) for p, own in drive.by_patch.items()}
    loudest, volts = max(drive.by_patch.items(), key=lambda own: float(np.abs(own[1]).max()))
    return {
        "name": press.button,
        "simulated": check.simulated,
        "created": button.created,
        "point": drive.point,
        "points": [one.drive.point for one in (whole, *whole.others)],
        "each_point": _each_point(whole, (button.press, *button.others)),
        "glance": glance_json(check_glance(check, feeling, press)),
        "check": check.summary() | {"reasons": _styled(check.reasons), "notes": _styled(check.notes)},
        "error_said": check.whole.said,
        "outside_said": check.outside.brief,
        "felt": one_style(feeling.sentence),
        "loudness_db": feeling.loudness_db,
        "in_band": drive.in_band,
        "notes": _styled(feeling.notes),
        "step_s": step / check.rate_hz,
        "recorded": np.round(recorded[begin:end:step], 4),
        "target": np.round(check.target[begin:end:step], 4),
        "measured": np.round(check.measured[begin:end:step], 4),
        "drives": drives,
        "loudest": loudest,
        "octaves_hz": check.octaves.hz,
        "recorded_db": third_octaves(recorded, check.rate_hz, low * 0.99, high * 1.01)[1],
        "drive_db": third_octaves(volts, drive.rate_hz, low * 0.99, high * 1.01)[1],
        "target_db": check.octaves.target_db,
        "measured_db": check.octaves.measured_db,
        "floor_db": check.octaves.floor_db,
        "checks": data.found(f"checks/{glob.escape(path.stem)}-*.h5"),
    }


def _styled(sentences: Sequence[str]) -> list[str]:
    return [one_style(one) for one in sentences]


def _seen(button: DigitalButton, check: Check, point: str) -> tuple[Check, Representative]:
    """The check and the press of the button at a point; "" is the drive's own."""
    seen = zip((check, *check.others), (button.press, *button.others), strict=False)
    for one, press in seen:
        if point in ("", one.drive.point):
            return one, press
    raise DataError(f"The digital {button.press.button} plays no button at the {point[:20]!r} point.")


def _each_point(check: Check, presses: Sequence[Representative]) -> list[dict[str, Any]]:
    """A row for each button, silent point and crosstalk, where a drive is for more points than one."""
    if not check.drive.elsewhere:
        return []
    rows: list[dict[str, Any]] = []
    own = f"error {check.whole.said}"
    errors = [own, *(text_of(known.lines[1]) for known in other_facts(check, presses[1:]))]
    for one, press, error in zip((check, *check.others), presses, errors, strict=False):
        rows.append(
            {
                "label": f"{press.button} at the {one.drive.point} point",
                "verdict": one.verdict,
                "said": one_style(f"{error}. {check_feeling(one, press).sentence}"),
            }
        )
    for known in (*silence_facts(check), *crosstalk_facts(check)):
        rows.append({"label": known.label, "said": one_style(text_of(known.lines[0]))})
    return rows


def _recorded(press: Representative, check: Check) -> FloatArray:
    """The recorded press at the times of a check, scaled as its target; zeros before and after."""
    samples = round(len(press.acceleration) * check.rate_hz / press.rate_hz)
    finer = check.drive.scale * resample(press.acceleration, samples)
    first = round(
        (activation_time(press, check.drive) - press.activation_index / press.rate_hz) * check.rate_hz
    )
    found = np.zeros(len(check.target))
    begin, end = max(0, first), min(len(found), first + samples)
    if begin < end:
        found[begin:end] = finer[begin - first : end - first]
    return found


def _loud(target: FloatArray) -> tuple[int, int]:
    """The part of a target that holds its motion, with a margin."""
    loud = np.flatnonzero(np.abs(target) > 0.01 * np.abs(target).max())
    if not len(loud):
        return 0, len(target)
    margin = max(1, (loud[-1] - loud[0]) // 10)
    return max(0, int(loud[0] - margin)), min(len(target), int(loud[-1] + margin))


def _times(begin: int, end: int, step: int, rate_hz: float) -> FloatArray:
    return np.arange(begin, end, step) / rate_hz


def _clock(drive: Drive) -> FloatArray:
    return np.arange(len(drive.target)) / drive.rate_hz
