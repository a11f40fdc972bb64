"""Answers as a tidy table: one CSV line an answer, and a JSON file that says what its columns mean."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...base.errors import DataError
from ...base.files import new_file, private_files
from ..protocol import Answer, ExperimentFile, Step, session_levels, timing_of
from .store import Event, Store, StoredSession

_COLUMNS = {
    "participant": "Pseudonym",
    "group": "Group of the participant",
    "day": "Number of the session, from 1",
    "block": "Part of the session",
    "trial": "Number of the trial in its block, from 1",
    "presented": "What was presented",
    "answered": "What the participant answered",
    "pair": "Pair of opposite adjectives; the scale goes from the first to the second",
    "rating": "Position of the slider",
    "touches": "How often the slider was touched; it has no value until it is",
    "first_touch": "First touch of the slider, from the appearance of the question",
    "last_touch": "Last touch of the slider, from the appearance of the question",
    "first_value": "Value of the compared quantity in the first interval",
    "second_value": "Value of the compared quantity in the second interval",
    "comparison": "Value that was compared with the standard",
    "correct": "Whether the answer was right",
    "onset": "Beginning of the stimulus, from the beginning of the program's run",
    "duration": "From the (last) beginning of the stimulus to the answer",
    "timing": "Whether a person can have answered in this time: possible, too fast, too slow; n/a of a "
    "simulated participant",
    "presentations": "How often the stimulus was presented before the answer",
    "time": "Time of the answer (UTC)",
    "complete": "Whether the session was completed: its log is sealed, and nothing of it is missing",
    "simulated": "Whether a simulated participant answered, and no person",
}
_UNITS = {"onset": "s", "duration": "s", "first_touch": "s", "last_touch": "s", "time": "ISO 8601"}


def export_answers(store: Store, path: str | Path, practice: bool = False) -> int:
    """Write the answers of all participants as CSV, and `NAME.json` beside it; return the number of lines.

    With `practice`, answers of practice blocks too. A session that was not completed is named in the JSON
    file, and its lines say so. The table fits `haploop analyse`. The JSON file describes
    the columns as a BIDS sidecar does. Raises DataError: no answer, a log that is damaged or has lost its
    end, a file that exists.
    """
    path = Path(path)
    file = store.experiment.file
    columns = [*_columns(file)]
    lines = [line for stored in store.sessions() for line in _lines(file, stored, practice)]
    if not lines:
        raise DataError(f"{store.folder} holds no answer to {file.name!r} yet: run a session first.")
    with private_files(), new_file(path) as part, new_file(path.with_suffix(".json")) as sidecar:
        with part.open("w", encoding="utf-8", newline="") as table:
            writer = csv.DictWriter(table, columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(lines)
        text = json.dumps(sidecar_of(store), indent=2, ensure_ascii=False)
        sidecar.write_text(text + "\n", encoding="utf-8")
    return len(lines)


def sidecar_of(store: Store) -> dict[str, Any]:
    """Describe the columns of an exported table, and the experiment."""
    file = store.experiment.file
    levels = {factor.name: list(factor.levels) for factor in file.factor}
    levels |= {"group": list(file.groups)}
    if file.kind == "rating":
        levels |= {"pair": list(file.pair_names)}
    if file.kind == "identification":
        levels |= {
            "presented": list(file.levels_of(file.question.identify, "trial")),
            "answered": list(file.answers),
        }
    described: dict[str, Any] = {}
    for column in _columns(file):
        entry: dict[str, Any] = {"Description": _COLUMNS.get(column, "Factor of the experiment")}
        if column in levels:
            entry["Levels"] = levels[column]
        if unit := _UNITS.get(column, ""):
            entry["Units"] = unit
        described[column] = entry
    if file.comparison and file.comparison.unit:
        for column in ("first_value", "second_value", "comparison"):
            described[column]["Units"] = file.comparison.unit
    if file.kind == "rating":
        described["rating"]["Range"] = list(file.question.scale)
    return {
        "TaskName": file.name,
        "TaskDescription": file.title,
        "ExperimentHash": store.experiment.content_hash,
        "Seed": file.seed,
        "GeneratedBy": "haploop",
        "Withdrawn": len(store.withdrawals()),
        "Unfinished": [f"{one.path.parent.name}/{one.path.name}" for one in store.unfinished()],
        **described,
    }


def _columns(file: ExperimentFile) -> Iterator[str]:
    yield from ("participant", "group", "day")
    yield from (factor.name for factor in file.session_factors)
    yield from ("block", "trial")
    yield from (factor.name for factor in file.trial_factors)
    match file.kind:
        case "identification":
            yield from ("presented", "answered", "correct")
        case "rating":
            yield from ("pair", "rating", "touches", "first_touch", "last_touch")
        case "two-interval" | "staircase":
            yield from ("first_value", "second_value", "comparison", "answered", "correct")
    yield from ("onset", "duration", "timing", "presentations", "time", "complete", "simulated")


def _lines(file: ExperimentFile, stored: StoredSession, practice: bool) -> Iterator[dict[str, Any]]:
    begins = {event.run: event.at for event in reversed(stored.events)}
    presentations: list[Event] = []
    steps = {event.number: (step, answer) for step, answer, event in stored.answers}
    for event in stored.events:
        if event.kind == "presented":
            presentations.append(event)
        if event.kind != "answer":
            continue
        step, answer = steps[event.number]
        shown, presentations = presentations, []
        if step.by_hand or (step.practice and not practice):
            continue
        assignment = stored.assignment
        same_run = bool(shown) and shown[-1].run == event.run
        duration = event.at - shown[-1].at if same_run else None
        line = {
            "participant": assignment.participant,
            "group": assignment.group,
            "day": assignment.session,
            **session_levels(file, assignment),
            "block": step.block,
            "trial": step.number,
            **{factor.name: step.stimulus[factor.name] for factor in file.trial_factors},
            "onset": f"{shown[-1].at - begins[event.run]:.3f}" if same_run else "n/a",
            "duration": "n/a" if duration is None else f"{duration:.3f}",
            "timing": "n/a" if stored.simulated else timing_of(answer, duration),
            "presentations": len(shown),
            "time": event.time,
            "complete": str(stored.complete).lower(),
            "simulated": str(stored.simulated).lower(),
        }
        for values in _answers(file, step, answer, event):
            yield line | values


def _answers(file: ExperimentFile, step: Step, answer: Answer, event: Event) -> Iterator[dict[str, Any]]:
    correct = str(event.values["correct"]).lower()
    if isinstance(answer, str | int):
        if step.kind == "identification":
            yield {"presented": step.presented, "answered": answer, "correct": correct}
        elif file.comparison:
            first, second = step.values
            compared = second if first == file.comparison.standard else first
            yield {
                "first_value": first,
                "second_value": second,
                "comparison": compared,
                "answered": answer,
                "correct": correct,
            }
    else:
        for pair, one in answer.items():
            yield {
                "pair": pair,
                "rating": f"{one.value:g}",
                "touches": len(one.touched),
                "first_touch": f"{one.touched[0]:.3f}",
                "last_touch": f"{one.touched[-1]:.3f}",
            }
