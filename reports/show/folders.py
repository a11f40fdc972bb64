"""What a command reads that is given a folder."""

from __future__ import annotations

from pathlib import Path

from ...calibration import Waveforms
from ...instruments import DataError

__all__ = ["files_of"]


def files_of(path: Path) -> list[Path]:
    """What to read of a file or folder: itself, the study whose recordings it holds, or the files in it.

    Raises DataError for a folder that holds nothing to read.
    """
    if not path.is_dir() or any((path / name).is_file() for name in ("study.toml", "map.json")):
        return [path]
    whole = path.resolve()
    if whole.name == "recordings" and (whole.parent / "study.toml").is_file():
        return [whole.parent]
    if (path / "experiment.toml").is_file():
        raise DataError(
            f"{path} is an experiment: write its table with `haploop experiment export {path} ANSWERS.csv`, "
            "and name that."
        )
    # Waveforms have no figure of their own: they belong to the calibration beside them.
    files = sorted(one for one in path.glob("*.h5") if not Waveforms.is_beside(one))
    if not files:
        raise DataError(
            f"{path} holds neither a study (study.toml), nor a map (map.json), nor files of haploop (.h5): "
            "name a folder that does, or files."
        )
    return files
