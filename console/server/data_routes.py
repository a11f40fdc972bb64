"""Files of the data folder as JSON: lists, presses, studies, calibrations, maps, digital buttons.

Only paths that `DataFolder` accepts are opened, and only for reading.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ...acquisition import Representative, load_study
from ...acquisition.recording import PartReader
from ...base.arrays import FloatArray
from ...base.errors import DataError, HaploopError
from ...base.hdf5 import kind_of
from ...calibration import Calibration, VibrationMap, Waveforms
from ...calibration.map import MapFolder
from ...experiments.shown import experiment_contents
from ...reports.catalogue import Member, lineage, list_files
from ...reports.contents import night
from ..data_folder import DataFolder, store_of
from .lab import lab, names, of_experiment, pace
from .shown_routes import answers, button_shown, figure, report, shown
from .shown_routes import night as night_report

_BEFORE, _AFTER = 0.25, 0.5
"""s around the activation of a press that are shown."""
_MOST_PRESSES = 12
_MOST_FILES = 500
_ASKED = ("kind", "participant", "button", "verdict")
_FORCE_HZ = 1000.0


def data_routes(data: DataFolder) -> list[Route]:
    """Return the routes that read the data folder."""

    def route(path: str, read: Callable[[DataFolder, Mapping[str, str]], Any]) -> Route:
        async def answer(request: Request) -> Response:
            def answered() -> Response:
                found = read(data, request.query_params)
                if isinstance(found, Response):
                    return found
                return Response(_json(found), media_type="application/json")

            try:
                # The text too is made beside the loop, which sends a frame of the live scope every 40 ms.
                return await asyncio.to_thread(answered)
            except HaploopError as error:
                return JSONResponse({"error": str(error)}, 409)
            except FileNotFoundError as error:
                return JSONResponse({"error": f"There is no file {error.filename}."}, 404)

        return Route(path, answer)

    return [
        route("/api/lab", lab),
        route("/api/names", names),
        route("/api/pace", pace),
        route("/api/files", _files),
        route("/api/catalogue", _catalogue),
        route("/api/presses", _presses),
        route("/api/study", _study),
        route("/api/experiment", _experiment),
        route("/api/calibration", _calibration),
        route("/api/history", _history),
        route("/api/shown", shown),
        route("/api/figure", figure),
        route("/api/lineage", _lineage),
        route("/api/night", night_report),
        route("/api/answers", answers),
        route("/api/report", report),
        route("/api/map", _map),
        route("/api/shape", _shape),
        route("/api/button", button_shown),
    ]


def _json(value: Any) -> bytes:
    return json.dumps(_plain(value), allow_nan=False, separators=(",", ":")).encode()


def _plain(value: Any) -> Any:
    """JSON values: numpy's numbers and arrays as Python's, NaN and infinity as null."""
    if isinstance(value, dict):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        whole = value.dtype.kind not in "fO" or (value.dtype.kind == "f" and np.isfinite(value).all())
        return value.tolist() if whole else _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _files(data: DataFolder, _: Mapping[str, str]) -> Any:
    found = data.found
    return {
        "recordings": found("recordings/*.h5") + found("*/recordings/*.h5"),
        "studies": [name.removesuffix("/study.toml") for name in found("*/study.toml")],
        "experiments": [name.removesuffix("/experiment.toml") for name in found("*/experiment.toml")],
        "calibrations": [n for n in found("calibrations-made/*.h5") if not Waveforms.is_beside(Path(n))],
        "maps": [name.removesuffix("/map.json") for name in found("maps/*/map.json")],
        "buttons": found("buttons/*.h5"),
        "checks": found("checks/*.h5"),
    }


def _catalogue(data: DataFolder, asked: Mapping[str, str]) -> Any:
    """What `haploop list` says of the folder: the newest files that meet the conditions of the page."""
    where = [f"{name}={asked[name]}" for name in _ASKED if asked.get(name)]
    where += [f"date>={asked['since']}"] if asked.get("since") else []
    where += filter(None, (one.strip() for one in asked.get("more", "").split(",")))
    data.root.mkdir(parents=True, exist_ok=True)
    found = [
        {**asdict(entry), "file": shown}
        for entry in list_files([data.root], where)
        if (shown := data.shown(Path(entry.file)))
    ]
    newest = sorted(found, key=lambda one: one["date"], reverse=True)
    return {"of": len(found), "files": newest[:_MOST_FILES]}


def _lineage(data: DataFolder, asked: Mapping[str, str]) -> Any:
    """What a file was made from and what was made from it, of the files of the folder."""
    path = data.path(asked.get("file", "")).resolve()
    found = lineage(list_files([data.root]), str(path))
    below = f"{data.root}{os.sep}"

    def member(one: Member) -> dict[str, str]:
        shown = data.shown(Path(one.file)) if one.file else ""
        return {"name": one.name, "file": shown, "note": one.note.replace(below, "")}

    nodes = [{**vars(one), "members": [member(each) for each in one.members]} for one in found.nodes]
    return {"nodes": nodes, "edges": found.edges}


def _presses(data: DataFolder, asked: Mapping[str, str]) -> Any:
    """The newest presses as the file holds them, and how much it holds: read and CRC-checked now."""
    path = data.path(asked.get("file", ""))
    if not path.exists():
        raise DataError(f"There is no file {path}.")
    recording = _reader(path)
    if isinstance(recording, Representative):
        return {"presses": [_averaged(recording)]}
    recording.look()
    rate_hz = recording.header.rate_hz
    count = recording.samples
    step = max(1, round(rate_hz / _FORCE_HZ))
    found = []
    for press in recording.verdicts[-_MOST_PRESSES:]:
        anchor = press.first if math.isnan(press.activation) else round(press.activation)
        first, end = max(0, anchor - round(_BEFORE * rate_hz)), min(count, anchor + round(_AFTER * rate_hz))
        found.append(
            {
                **_shown(recording, first, end, step),
                "number": press.number,
                "attempt": press.attempt,
                "accepted": press.accepted,
                "reason": press.reason,
                "force_n": None if math.isnan(press.force) else press.force,
                "start_s": (first - anchor) / rate_hz,
            }
        )
    return {
        "file": data.name(path),
        "simulated": recording.header.simulated,
        "state": recording.state,
        "samples": count,
        "channels": len(recording.header.channels),
        "bytes": 2 * count * len(recording.header.channels),
        "file_bytes": path.stat().st_size,
        "events": [event._asdict() for event in recording.events[-20:]],
        "presses": found,
    }


def _shown(recording: PartReader, first: int, end: int, step: int) -> dict[str, Any]:
    """What a press shows: force or travel, and acceleration or velocity, as far as they were measured."""
    rate_hz = recording.header.rate_hz
    shown: dict[str, Any] = {}
    for quantity, label, scale in (("force", "force (N)", 1.0), ("displacement", "travel (mm)", 1e3)):
        if recording.has(quantity) and "slow" not in shown:
            values = scale * _means(recording.along(quantity, first, end), step)
            shown |= {"slow": np.round(values, 4), "slow_step_s": step / rate_hz, "slow_label": label}
    for quantity, label, scale in (("acceleration", "m/s²", 1.0), ("velocity", "mm/s", 1e3)):
        if recording.has(quantity) and "fast" not in shown:
            values = scale * recording.along(quantity, first, end)
            middle = values - np.median(values) if len(values) else values
            shown |= {"fast": np.round(middle, 2), "fast_step_s": 1 / rate_hz, "fast_label": label}
    return shown


def _averaged(press: Representative) -> dict[str, Any]:
    """A representative press, as one of a recording."""
    step_s = 1 / press.rate_hz
    shown = {"fast": np.round(press.acceleration, 3), "fast_step_s": step_s, "fast_label": "m/s²"}
    if press.force is not None:
        shown |= {"slow": np.round(press.force, 4), "slow_step_s": step_s, "slow_label": "force (N)"}
    return {**shown, "number": 0, "accepted": True, "start_s": -press.activation_index * step_s}


@lru_cache(maxsize=2)
def _reader(path: Path) -> PartReader | Representative:
    """The reader of a recording, kept from press to press, or what was averaged."""
    return Representative.load(path) if kind_of(path) == "representative" else PartReader(path)


def _means(values: FloatArray, step: int) -> FloatArray:
    count = len(values) // step
    return np.asarray(values[: count * step].reshape(count, step).mean(axis=1))


def _study(data: DataFolder, asked: Mapping[str, str]) -> Any:
    study = load_study(data.study(asked.get("study", "")))
    return {
        "name": study.file.name,
        "participants": study.file.participants,
        "buttons": study.file.buttons,
        "entries": [
            {
                "participant": entry.participant,
                "button": entry.button,
                "accepted": len(entry.accepted),
                "of": entry.of,
                "bad": entry.bad,
                "rejected": entry.rejected,
                "interrupted": entry.interrupted,
                "in_progress": entry.in_progress,
                "consented": entry.consented,
                "recordings": [data.name(recording.path) for recording in entry.recordings],
            }
            for entry in study.progress()
        ],
    }


def _experiment(data: DataFolder, asked: Mapping[str, str]) -> Any:
    store = store_of(data, asked.get("experiment", ""))
    file = store.experiment.file
    about = {"title": file.title or file.name, "groups": file.groups, "days": file.sessions}
    about |= {"consent": file.consent, "buttons": [*file.buttons], "estimate": of_experiment(store)}
    return {**about, **experiment_contents(store).values}


def _calibration(data: DataFolder, asked: Mapping[str, str]) -> Any:
    found = Calibration.load(data.path(asked.get("file", "")))
    response, model = found.response, found.model
    return {
        "patch": response.patch,
        "point": response.point,
        "simulated": response.simulated,
        "created": response.created,
        "frequency": response.frequencies,
        "response": np.abs(response.velocity),
        "model": np.abs(model.velocity(response.frequencies)),
        "error": model.error,
        "coherence": response.coherence,
        "resonances": [{"frequency_hz": r.frequency_hz, "damping": r.damping} for r in model.resonances],
    }


def _history(data: DataFolder, _: Mapping[str, str]) -> Any:
    history = data.history
    return {
        "generations": [generation.name for generation in history.generations],
        "activations": [vars(activation) for activation in history.activations],
        "folder": history.folder.as_posix(),
        "nights": [night(history, look) for look in reversed(history.looks)],
    }


def _map(data: DataFolder, asked: Mapping[str, str]) -> Any:
    """What was measured so far: rms velocity per volt at each point, for each play."""
    folder = MapFolder.open(data.path(asked.get("map", "")))
    plan, points = folder.plan, {}
    for step in plan.steps:
        if step.again:
            continue
        measured = _point(folder.file(step)) if folder.file(step).exists() else None
        if measured is not None:
            points[step.point] = measured
    return {
        "rows": plan.rows,
        "columns": plan.columns,
        "points": plan.points,
        "patches": plan.patches,
        "simulated": plan.simulated,
        "measured": points,
        "skipped": folder.skipped(),
    }


@lru_cache(maxsize=4096)
def _point(path: Path) -> dict[str, float]:
    """m/s per V of each play at a point, rms over the lines; the file of a point never changes."""
    folder = MapFolder.open(path.parent)
    step = next(step for step in folder.plan.steps if folder.file(step) == path)
    measured = folder.read(step)
    assert measured is not None
    found = {}
    for row, (play, patch) in enumerate(measured.rows):
        gain = _rms(measured.velocity[play]) / _rms(measured.drives[row])
        if measured.plays[play] != "all":
            found[patch] = gain
    return found


def _rms(values: NDArray[Any]) -> float:
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


def _shape(data: DataFolder, asked: Mapping[str, str]) -> Any:
    """The shape of the mode nearest to a frequency, for the animation: (rows, columns), the largest is 1."""
    found = VibrationMap.load(data.path(asked.get("map", "")))
    resonances = [frequency for frequency, _ in found.resonances()]
    try:
        near = float(asked.get("frequency", "263"))
    except ValueError:
        near = math.nan
    if not resonances or not math.isfinite(near):
        raise DataError("The map shows no resonance near that frequency.")
    frequency = min(resonances, key=lambda f: abs(f - near))
    shape = found.grid(np.asarray(found.shape(frequency)))
    return {"frequency_hz": frequency, "resonances": resonances, "shape": shape / np.nanmax(np.abs(shape))}
