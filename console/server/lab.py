"""The state of the lab for the console's pages: calibration and drift, newest results, what is due, names."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...acquisition import load_study
from ...base.errors import DataError, HaploopError
from ...exchange.catalogue import list_files
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
