"""What the worker can be asked to do with the rig: one function a kind of job.

Each checks its parameters before the rig is opened, and returns what is to be done with the open rig. A
job returns JSON values, which the board keeps as the job's result.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from ...acquisition import (
    Protocol,
    Recording,
    file_name,
    load_study,
    look,
    record,
    run_study,
    segmentation_for,
    set_aside,
)
from ...base.errors import ConfigurationError, DataError
from ...base.files import check_destination, reserved
from ...calibration import Waveforms, activate, calibrate_keeping, examine, map_plan, measure_map, sizes
from ...instruments import Rig
from ...instruments.operator import ConfirmSettings
from ...reports.contents import one_style
from ..data_folder import clean, store_of, whole
from .button_jobs import ACTOR, adopt_button, check, make
from .job import Job, Tools, Work, numbers, words
from .presenting import present_stimuli

_PAUSE = 1800.0
"""s: total pause of a session; the space for its samples is allocated before the first one."""
_BLOCK = 0.04
"""s: 25 blocks a second, so that the live view moves 20 times a second or more."""
_WAIT = 600.0
_SPACE = 1e9
"""Bytes free below which the preflight is not green: a session allocates up to some hundred megabytes."""
_OLD_DAYS = 1.0
"""Time since the active calibration was made or verified, from which the preflight is not green."""


def _notes(tools: Tools, given: object) -> str:
    """Notes of a recording, with the reason why the preflight was not green."""
    preflight = tools.board["preflight"] or {}
    reason = preflight.get("override")
    notes = clean(given or "", "The notes")
    return " ".join(filter(None, (notes, f"Preflight overridden: {reason}" if reason else "")))


def _look(tools: Tools, _wanted: Mapping[str, Any]) -> Work:
    tools.looking.set()

    def work(rig: Rig) -> dict[str, Any]:
        look(rig, tools.looking.is_set)
        return {}

    return work


def _record(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    button, participant = str(wanted.get("button", "")), str(wanted.get("participant", ""))
    presses = whole(wanted.get("presses", 10), "The number of presses", 1, 200)
    notes = _notes(tools, wanted.get("notes"))
    out = tools.data.path("recordings")
    name = str(wanted.get("name") or "")
    path = out / file_name(participant, button, name)
    set_aside(path)
    check_destination(path)
    protocol = Protocol(block=_BLOCK, wait=_WAIT, pause=_PAUSE, segmentation=segmentation_for(button))

    def work(rig: Rig) -> dict[str, Any]:
        _session(tools, participant, button, presses, "recordings")
        recording = record(
            rig,
            button,
            participant,
            presses,
            out,
            progress=tools.board.progress,
            on_verdict=lambda press: tools.board.verdict(participant, button, press),
            protocol=protocol,
            notes=notes,
            name=name,
        )
        return {"file": tools.data.name(path), "samples": _samples(recording)}

    return work


def _study(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    folder = tools.data.study(wanted.get("study", ""))
    study = load_study(folder)
    participants = [str(wanted["participant"])] if wanted.get("participant") else []
    buttons = [str(wanted["button"])] if wanted.get("button") else []
    for participant in participants or study.file.participants:
        for button in buttons or study.file.buttons:
            study.progress_of(participant, button)
    notes = _notes(tools, wanted.get("notes"))

    def work(rig: Rig) -> dict[str, Any]:
        _session(tools, "", "", 0, tools.data.name(study.folder))
        complete = run_study(
            rig,
            study,
            participants,
            buttons,
            progress=tools.board.progress,
            on_verdict=tools.board.verdict,
            notes=notes,
            adapt=lambda protocol: replace(protocol, pause=_PAUSE, block=_BLOCK),
        )
        return {"study": tools.data.name(folder), "complete": complete}

    return work


def _session(tools: Tools, participant: str, button: str, of: int, folder: str) -> None:
    """Begin a session on the board; its verdicts follow."""
    tools.board.set(
        session={"participant": participant, "button": button, "of": of, "folder": folder, "verdicts": []},
        paused=False,
        saturated={},
    )


def _samples(recording: Recording) -> int:
    return round(recording.duration * recording.rate_hz)


def _preflight(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    mass = float(wanted.get("mass") or 0.5)
    if not 0.05 <= mass <= 10:
        raise ConfigurationError(f"The mass must be 0.05 to 10 kg, not {mass:g}.")

    def work(rig: Rig) -> dict[str, Any]:
        findings = [
            _finding(one.name, one.instrument, one.status, one_style(one.sentence))
            for one in examine(rig, mass, tools.board.progress)
        ]
        findings += [_space(tools), _calibrated(tools)]
        if rig.file.amplifier is not None and rig.mode is None:
            findings.append(_amplifier_off(rig))
        worst = "red" if any(f["status"] == "red" for f in findings) else "yellow"
        green = all(f["status"] == "green" for f in findings)
        found = {
            "status": "green" if green else worst,
            "findings": findings,
            "when": datetime.now(UTC).isoformat(timespec="seconds"),
            "override": "",
        }
        tools.board.set(preflight=found)
        return {"status": found["status"]}

    return work


def _finding(name: str, instrument: str, status: str, sentence: str) -> dict[str, Any]:
    return {"name": name, "instrument": instrument, "status": status, "sentence": sentence}


def _space(tools: Tools) -> dict[str, Any]:
    tools.data.root.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(tools.data.root).free
    sentence = f"{free / 1e9:.1f} GB are free in {tools.data.root}"
    if free < _SPACE:
        return _finding("Disk space", "console", "red", f"{sentence}: free at least {_SPACE / 1e9:g} GB.")
    return _finding("Disk space", "console", "green", f"{sentence}.")


def _calibrated(tools: Tools) -> dict[str, Any]:
    history = tools.data.history
    try:
        active = history.active()
    except DataError:
        sentence = "No calibration is active yet: recording does not need one, digital buttons do."
        return _finding("Active calibration", "table", "green", sentence)
    days = _days(history.activations[-1].when)
    sentence = f"{active.name} has been active for {days:.1f} days"
    looks = [look for look in history.looks if look.get("compared_with") == active.name]
    if looks:
        verified = _days(looks[-1]["when"])
        sentence += f", and recalibrate found it {looks[-1]['outcome']} {verified:.1f} days ago"
        days = min(days, verified) if looks[-1]["outcome"] == "unchanged" else math.inf
    if days > _OLD_DAYS:
        return _finding(
            "Active calibration", "table", "yellow", f"{sentence}: verify it (haploop recalibrate)."
        )
    return _finding("Active calibration", "table", "green", f"{sentence}.")


def _days(when: str) -> float:
    """Days since a time of the history."""
    return (datetime.now(UTC) - datetime.fromisoformat(when)).total_seconds() / 86_400


def _amplifier_off(rig: Rig) -> dict[str, Any]:
    question = ConfirmSettings("Is the amplifier switched off? Recording a physical button needs no drive.")
    if rig.operator.confirm(question):
        return _finding("Amplifier", "amplifier", "green", "The operator confirms that it is off.")
    return _finding("Amplifier", "amplifier", "yellow", "It is on: switch it off before somebody presses.")


def _calibrate(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    patch, point = str(wanted.get("patch", "A")), str(wanted.get("point", "button"))
    name = clean(wanted.get("name") or f"{patch}-{point}", "The name", 1)
    path = tools.data.path(f"calibrations-made/{name}.h5")
    beside = Waveforms.beside(path)
    check_destination(path)
    check_destination(beside)

    def work(rig: Rig) -> dict[str, Any]:
        with reserved(path, beside, size=sizes.CALIBRATION + sizes.WAVEFORMS):
            calibration, waveforms = calibrate_keeping(rig, patch, point, tools.board.progress)
            calibration.save(path)
            waveforms.save(beside)
        return {"file": tools.data.name(path)}

    return work


def _map(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    points = numbers(str(wanted.get("points") or ""))
    patches = words(wanted.get("patches")) or None
    folder = tools.data.path(f"maps/{clean(wanted.get('name') or 'map', 'The name', 1)}")

    def work(rig: Rig) -> dict[str, Any]:
        plan = map_plan(rig, points=points, patches=patches)
        tools.board.set(map=tools.data.name(folder))
        folder.parent.mkdir(parents=True, exist_ok=True)
        done = measure_map(rig, folder, plan, tools.board.progress)
        return {"map": tools.data.name(folder), "skipped": done.skipped()}

    return work


def _activate(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    name = str(wanted.get("generation", ""))
    reason = clean(wanted.get("reason", ""), "The reason", 3)

    def work(_: Rig) -> dict[str, Any]:
        history = tools.data.history
        return {"generation": activate(history, name, actor=ACTOR, reason=reason, rig=tools.file).name}

    return work


def _surface(tools: Tools, wanted: Mapping[str, Any]) -> Work:
    name = str(wanted.get("experiment", ""))
    store = store_of(tools.data, name)
    if not store.experiment.file.buttons:
        raise ConfigurationError(f"The experiment {name} has no [buttons] for the rig to play.")

    def work(rig: Rig) -> dict[str, Any]:
        present_stimuli(rig, name, store, tools.board, tools.stimuli)
        return {}

    return work


def _safe(_tools: Tools, _wanted: Mapping[str, Any]) -> Work:
    def work(rig: Rig) -> dict[str, Any]:
        rig.make_safe()
        return {}

    return work


JOBS: dict[str, Job] = {
    "look": Job(_look, lambda _: "Look at the sensors"),
    "preflight": Job(_preflight, lambda _: "Preflight"),
    "record": Job(_record, lambda p: f"Record {p.get('button')} by {p.get('participant')}", gated=True),
    "study": Job(_study, lambda p: f"Study {p.get('study')}", gated=True),
    "calibrate": Job(_calibrate, lambda p: f"Calibrate patch {p.get('patch', 'A')}"),
    "map": Job(_map, lambda p: f"Map {p.get('name') or 'map'}"),
    "make": Job(make, lambda p: f"Make a digital button {p.get('name') or ''}".strip()),
    "check": Job(check, lambda p: f"Play {p.get('button')}"),
    "adopt": Job(adopt_button, lambda p: f"Adopt {p.get('button')}", needs_rig=False),
    "activate": Job(_activate, lambda p: f"Activate {p.get('generation')}", needs_rig=False),
    "surface": Job(_surface, lambda p: f"Rig for the experiment {p.get('experiment')}"),
    "safe": Job(_safe, lambda _: "Reach the safe state"),
}
