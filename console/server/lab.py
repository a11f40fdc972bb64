"""The state of the lab for the console's pages, and how long a sitting takes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...acquisition import Recording, load_study
from ...base.errors import DataError, HaploopError
from ...experiments import Assignment, Course, Step, Store, StoredSession, group_of_slot
from ...reports.catalogue import list_files
from ...reports.contents import counted
from ..data_folder import DataFolder

_NEWEST = 6
"""Results that are shown."""
_NAMED = 3
"""Sessions due that are named."""


def lab(data: DataFolder, _: Mapping[str, str]) -> dict[str, Any]:
    """The active calibration, the newest recordings, buttons and checks, and studies with what is due."""
    return {"calibration": _calibration(data), "newest": _newest(data), "studies": _studies(data)}


def names(data: DataFolder, _: Mapping[str, str]) -> dict[str, Any]:
    """Participants and buttons of the studies and of what was recorded, and its other recordings."""
    studies = []
    for path in data.root.glob("*/study.toml"):
        with suppress(HaploopError):  # the first page says what is wrong with it
            studies.append(load_study(data.study(data.shown(path).removesuffix("/study.toml"))).file)
    data.root.mkdir(parents=True, exist_ok=True)
    recorded = list_files([data.root], ["kind=recording"])
    return {
        "participants": {
            "study": sorted({name for study in studies for name in study.participants}),
            "recorded": sorted({entry.participant for entry in recorded} - {""}),
        },
        "buttons": {
            "study": sorted({name for study in studies for name in study.buttons}),
            "recorded": sorted({entry.button for entry in recorded} - {""}),
        },
        "recordings": sorted(path.stem for path in data.root.glob("recordings/*.h5")),
    }


def _calibration(data: DataFolder) -> dict[str, Any]:
    """Name and age of the active calibration, and what the last look at it found; a sentence without one."""
    history = data.history
    try:
        active = history.active()
    except DataError as error:
        # Without any, that is no fault: digital buttons need one, recording does not.
        return {"name": "", "problem": str(error) if history.generations else ""}
    looks = [look for look in history.looks if look.get("compared_with") == active.name]
    last = looks[-1] if looks else {}
    return {
        "name": active.name,
        "since": history.activations[-1].when,
        "looked": last.get("when", ""),
        "outcome": last.get("outcome", ""),
        "problem": "",
    }


def _newest(data: DataFolder) -> list[dict[str, str]]:
    data.root.mkdir(parents=True, exist_ok=True)
    found = []
    for entry in list_files([data.root]):
        shown = data.shown(Path(entry.file))
        if shown and entry.kind in ("recording", "button", "check"):
            result = " ".join(filter(None, (entry.verdict, entry.presses)))
            about = " ".join(filter(None, (entry.participant, entry.button)))
            # A check has no date of its own.
            date = entry.date or datetime.fromtimestamp(Path(entry.file).stat().st_mtime, UTC).isoformat()
            found.append({"file": shown, "kind": entry.kind, "about": about, "date": date, "result": result})
    return sorted(found, key=lambda one: one["date"], reverse=True)[:_NEWEST]


def _studies(data: DataFolder) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    for path in sorted(data.root.glob("*/study.toml")):
        name = data.shown(path).removesuffix("/study.toml")
        if not name:
            continue
        try:
            progress = load_study(data.study(name)).progress()
        except HaploopError as error:
            found.append({"name": name, "problem": str(error)})
            continue
        due = [f"{one.participant} {one.button}" for one in progress if len(one.accepted) < one.of]
        accepted, wanted = sum(len(one.accepted) for one in progress), sum(one.of for one in progress)
        found.append(
            {"name": name, "problem": "", "accepted": accepted, "of": wanted}
            | {"due": due[:_NAMED], "more": max(0, len(due) - _NAMED)}
        )
    return found


# How long a sitting takes: from its steps, and from the pace of earlier ones where there are any.
#
# Of an experiment's steps the middle half of the measured times gives the range, so that no break counts.
# Where nothing was measured, what a step takes is assumed, and said to be.

_PRESS = (10.0, 30.0)
"""s of a press with all that belongs to it, before one was recorded. The paper's participants took about
15 min each for 30 presses, consent included: 30 s."""
_TRIAL = (5.0, 15.0)
"""s of a trial, before one was answered: an estimate of ours."""
_PRESSED = (2.0, 5.0)
"""s of a press of a physical button between trials, which is not recorded: an estimate of ours."""
_RATED = (10.0, 45.0)
"""s of an adjective pair: the paper's participants took 30 min for six buttons of seven pairs: 43 s."""
_NEWEST_SITTINGS = 12
"""Recordings from which a pace is told."""


def pace(data: DataFolder, _: Mapping[str, str]) -> dict[str, Any]:
    """Seconds of a press, as the newest complete recordings took them, or assumed."""
    data.root.mkdir(parents=True, exist_ok=True)
    found = list_files([data.root], ["kind=recording", "verdict=complete"])
    people = [one for one in found if one.simulated == "no"]
    newest = sorted(people or found, key=lambda one: one.date)[-_NEWEST_SITTINGS:]
    each = [one for entry in newest if (one := _seconds_a_press(Path(entry.file), entry.content_hash))]
    if not each:
        low, high = _PRESS
        return {"low_s": low, "high_s": high, "said": f"assumed: {low:g} to {high:g} s a press"}
    low, high = min(each), max(each)
    told = f"at the measured pace of {counted(len(each), 'recording' if people else 'simulated recording')}"
    return {"low_s": low, "high_s": high, "said": f"{told} ({low:.1f} to {high:.1f} s a press)"}


@lru_cache(maxsize=1024)
def _seconds_a_press(path: Path, _content: str) -> float | None:
    """Duration over attempts; None for an imported recording, which tells nothing of this lab's pace."""
    try:
        recording = Recording.open(path)
        attempts = len(recording.verdicts)
        return None if recording.imported or not attempts else recording.duration / attempts
    except DataError:
        return None


def of_experiment(store: Store) -> dict[str, Any]:
    """Seconds of a participant's session: its steps, each at the measured pace of its block, or assumed."""
    file = store.experiment.file
    steps = Course(file, Assignment("P01", 0, group_of_slot(file, 0), 1)).firsts()
    measured = _step_times(store)
    low = high = 0.0
    for step in steps:
        own = measured.get(step.block)
        least, most = _quartiles([seconds for _, seconds in own]) if own else _assumed(step)
        # A staircase ends when it has found its threshold: how soon is not known beforehand.
        fewest = step.of / 3 if step.kind == "staircase" else step.of
        low, high = low + fewest * least, high + step.of * most
    new = [step.block for step in steps if step.block not in measured]
    sessions = len({who for own in measured.values() for who, _ in own})
    most_of = "up to " if any(step.kind == "staircase" for step in steps) else ""
    total = f"{most_of}{counted(sum(step.of for step in steps), 'step')}"
    told = f"at the measured pace of {counted(sessions, 'earlier session')}"
    if not sessions:
        told = "what each takes is assumed, as no session has measured it yet"
    elif new:
        told += f", and assumed for {', '.join(new)}"
    return {"low_s": low, "high_s": high, "said": f"{total}; {told}"}


def _assumed(step: Step) -> tuple[float, float]:
    if step.kind == "presses":
        return step.repetitions * _PRESSED[0], step.repetitions * _PRESSED[1]
    if step.kind == "rating":
        return len(step.choices) * _RATED[0], len(step.choices) * _RATED[1]
    return _TRIAL


def _step_times(store: Store) -> dict[str, list[tuple[Path, float]]]:
    """Of each block: from one answer to the next within a run and a block, with the session's log.

    What an operator paused is left out, and simulated participants, who do not take a person's time.
    """
    found: dict[str, list[tuple[Path, float]]] = {}
    for session in _readable(store):
        marks = [one for one in session.events if one.kind in ("presented", "answer", "pause", "resumed")]
        last, block = None, ""
        for event in marks:
            if event.kind in ("pause", "resumed"):
                last = None
                continue
            if event.values["block"] != block:
                last, block = event.at, event.values["block"]
            if event.kind == "answer":
                if last is not None:
                    found.setdefault(block, []).append((session.path, event.at - last))
                last = event.at
            elif last is None:
                last = event.at
    return found


def _readable(store: Store) -> Iterator[StoredSession]:
    for participant in store.participants():
        for number in range(1, store.experiment.file.sessions + 1):
            with suppress(DataError):  # a damaged log: the page says so
                session = store.session(participant, number)
                if session is not None and not session.simulated:
                    yield session


def _quartiles(values: Sequence[float]) -> tuple[float, float]:
    """The ends of the middle half."""
    low, high = np.quantile(values, (0.25, 0.75))
    return float(low), float(high)
