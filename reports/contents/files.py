"""What files, folders and values of haploop say: which function makes the contents of each."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ... import acquisition, calibration
from ...base import hdf5
from ...base.errors import DataError
from ...base.wording import capital
from .. import contents
from ..catalogue import Entry, stated
from ..loading import RESULTS, read_result
from .parts import Contents, Grid, fact
from .words import counted

if TYPE_CHECKING:
    from ...acquisition import Recording, Representative


_SAID = {
    "recording": "recording_contents",
    "representative": "press_contents",
    "calibration": "calibration_contents",
    "waveforms": "waveforms_contents",
    "drive": "drive_contents",
    "check": "check_contents",
    "button": "button_contents",
    "map": "map_contents",
    "plan": "plan_contents",
    "curve": "curve_contents",
}
"""Name of the function that says what a result of each kind says; `_said` imports it."""


def contents_of(value: Any) -> Contents:
    """What a result says. Raises DataError for damaged data, TypeError for what is no result."""
    if isinstance(value, calibration.History):
        return contents.history_contents(value)
    for kind in _SAID:
        if isinstance(value, RESULTS[kind]()):
            return _said(kind, value)
    raise TypeError(f"{type(value).__name__} is nothing that haploop shows.")


def file_contents(path: str | Path, presses: Sequence[Representative] = ()) -> Contents:
    """What a file, or the folder of a vibration map or of a history of calibrations, says.

    A check is shown beside the one of `presses` that its drive was computed for. Raises DataError for a file
    that is missing, damaged, or of another kind.
    """
    path = Path(path)
    if is_history(path):
        return contents.history_contents(calibration.History(path))
    kind = "map" if path.is_dir() else hdf5.kind_of(path)
    if kind not in _SAID:
        raise DataError(f"{path} holds a {kind}, which `haploop show` cannot display.")
    value = read_result(kind, path)
    if kind == "check":
        return contents.check_contents(value, next(filter(value.drive.is_of, presses), None))
    return _said(kind, value)


def _said(kind: str, value: Any) -> Contents:
    say: Callable[[Any], Contents] = getattr(contents, _SAID[kind])
    return say(value)


def is_history(path: Path) -> bool:
    """Whether a path is the folder of a rig's history of calibrations."""
    return (path / "activations.json").is_file()


def files_of(path: Path) -> list[Path]:
    """What to read of a file or folder: itself, the study whose recordings it holds, or the files in it; of a
    demo, those in its folders too.

    Raises DataError for a folder that holds nothing to read.
    """
    marks = ("study.toml", "map.json", "experiment.toml")
    if not path.is_dir() or is_history(path) or any((path / name).is_file() for name in marks):
        return [path]
    whole = path.resolve()
    if whole.name == "recordings" and (whole.parent / "study.toml").is_file():
        return [whole.parent]
    # Waveforms have no figure of their own: they belong to the calibration beside them.
    patterns = ("*/*.h5", "*.h5") if (path / "summary.json").is_file() else ("*.h5",)
    files = sorted(
        one for some in patterns for one in path.glob(some) if not calibration.Waveforms.is_beside(one)
    )
    if not files:
        raise DataError(
            f"{path} holds neither a study (study.toml), nor a map (map.json), nor files of haploop (.h5): "
            "name a folder that does, or files."
        )
    return files


def recordings_in(paths: Sequence[Path]) -> list[Recording]:
    """Open recordings, and those of studies and in folders. Raises DataError for files of other kinds."""
    found: list[Recording] = []
    for one in (file for path in paths for file in files_of(path)):
        if (one / "experiment.toml").is_file():
            raise DataError(
                f"{one} is an experiment: `haploop report {one}` shows its scores, and `haploop experiment "
                f"export {one} ANSWERS.csv` writes its answers."
            )
        if one.is_dir() or one.suffix == ".toml":
            study = acquisition.load_study(one)
            found += (recording for button in study.file.buttons for recording in study.recordings(button))
            continue
        kind = hdf5.kind_of(one)
        if kind != "recording":
            raise DataError(
                f"{one} holds a {kind}, and several files are shown together only when all are recordings: "
                "show it alone, or name all of them to `haploop report`."
            )
        found.append(acquisition.Recording.open(one))
    return found


# The files that `haploop list` found.

_COLUMNS = ("participant", "button", "date", "verdict", "presses")


def listing_contents(entries: Sequence[Entry]) -> Contents:
    """Entries, one a line in a table for each kind, and how many they are; simulated ones are marked."""
    rigs = {_rig(entry) for entry in entries if entry.rig}
    mixed = len(rigs) != 1 or len({entry.simulated for entry in entries} - {""}) > 1
    of_one = "" if mixed else f", all of the rig {rigs.pop()}"
    of_kinds = groupby(sorted(entries, key=lambda entry: entry.kind), key=lambda entry: entry.kind)
    return Contents(
        "",
        [fact(files=[_plain(entry) for entry in entries])],
        [_grid(kind, list(some), mixed) for kind, some in of_kinds],
        [f"{counted(entries, 'file')}{of_one}.", *(entry.problem for entry in entries if entry.problem)],
    )


def _plain(entry: Entry) -> dict[str, Any]:
    """An entry as JSON values."""
    sources = [
        {"kind": one.kind, "name": one.name, "content_hash": one.content} for one in stated(entry.made_from)
    ]
    return asdict(entry) | {"made_from": sources}


def _grid(kind: str, entries: Sequence[Entry], with_rig: bool) -> Grid:
    """The table of one kind: files below their common folder, and the columns in which any has a word."""
    paths = [Path(entry.file) for entry in entries]
    try:
        folder = Path(os.path.commonpath([path.parent for path in paths]))
    except ValueError:  # on several drives of Windows
        folder = Path()
    columns = {"file": [str(path.relative_to(folder) if folder.parts else path) for path in paths]}
    columns |= {name: [_cell(entry, name) for entry in entries] for name in _COLUMNS}
    if with_rig:
        columns["rig"] = [_rig(entry) for entry in entries]
    said = {name: cells for name, cells in columns.items() if any(cells)}
    rows = list(zip(*said.values(), strict=True))
    title = f"{kind}, in {_near(folder)}" if folder.parts else kind
    return Grid(title, [capital(name) for name in said], rows, words=len(said))


def _cell(entry: Entry, name: str) -> str:
    said = str(getattr(entry, name))
    return said[:16].replace("T", " ") if name == "date" else said


def _rig(entry: Entry) -> str:
    marked = entry.simulated == "yes" and entry.rig != "simulated"
    return f"{entry.rig} (simulated)".strip() if marked else entry.rig


def _near(folder: Path) -> str:
    here = Path.cwd()
    return str(folder.relative_to(here)) if folder.is_relative_to(here) else str(folder)
