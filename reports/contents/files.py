"""What files, folders and values of haploop say: which function makes the contents of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...acquisition import Recording, Representative, load_study
from ...base import hdf5
from ...base.errors import DataError
from ...calibration import Check, History, Waveforms
from ...exchange.loading import RESULTS
from .calibration import calibration_contents, drive_contents, waveforms_contents
from .check import button_contents, check_contents
from .curve import curve_contents
from .history import history_contents
from .map import map_contents
from .parts import Contents
from .plan import plan_contents
from .press import press_contents
from .recording import recording_contents

_SAID: dict[str, Callable[[Any], Contents]] = {
    "recording": recording_contents,
    "representative": press_contents,
    "calibration": calibration_contents,
    "waveforms": waveforms_contents,
    "drive": drive_contents,
    "check": check_contents,
    "button": button_contents,
    "map": map_contents,
    "plan": plan_contents,
    "curve": curve_contents,
}
"""The function that says what a result of each kind says."""


def contents_of(value: Any) -> Contents:
    """What a result says. Raises DataError for damaged data, TypeError for what is no result."""
    if isinstance(value, History):
        return history_contents(value)
    for kind, say in _SAID.items():
        if isinstance(value, RESULTS[kind][0]):
            return say(value)
    raise TypeError(f"{type(value).__name__} is nothing that haploop shows.")


def file_contents(path: str | Path, presses: Sequence[Representative] = ()) -> Contents:
    """What a file, or the folder of a vibration map or of a history of calibrations, says.

    A check is shown beside the one of `presses` that its drive was computed for. Raises DataError for a file
    that is missing, damaged, or of another kind.
    """
    path = Path(path)
    if is_history(path):
        return history_contents(History(path))
    kind = "map" if path.is_dir() else hdf5.kind_of(path)
    if kind not in _SAID:
        raise DataError(f"{path} holds a {kind}, which `haploop show` cannot display.")
    value = RESULTS[kind][1](path)
    if isinstance(value, Check):
        return check_contents(value, next(filter(value.drive.is_of, presses), None))
    return _SAID[kind](value)


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
    files = sorted(one for some in patterns for one in path.glob(some) if not Waveforms.is_beside(one))
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
            study = load_study(one)
            found += (recording for button in study.file.buttons for recording in study.recordings(button))
            continue
        kind = hdf5.kind_of(one)
        if kind != "recording":
            raise DataError(
                f"{one} holds a {kind}, and several files are shown together only when all are recordings: "
                "show it alone, or name all of them to `haploop report`."
            )
        found.append(Recording.open(one))
    return found
