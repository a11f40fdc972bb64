"""Load any file or folder that haploop writes, as the object that it holds."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, overload

from .. import acquisition, calibration
from ..base import hdf5
from ..base.errors import DataError
from .satellites import owned

RESULTS: Mapping[str, Callable[[], Any]] = {
    "recording": lambda: acquisition.Recording,
    "representative": lambda: acquisition.Representative,
    "calibration": lambda: calibration.Calibration,
    "waveforms": lambda: calibration.Waveforms,
    "drive": lambda: calibration.Drive,
    "check": lambda: calibration.Check,
    "button": lambda: calibration.DigitalButton,
    "map": lambda: calibration.VibrationMap,
    "plan": lambda: calibration.ButtonPlan,
    "curve": lambda: acquisition.Curve,
}
"""Gives the class of a kind of result: only what a file holds is imported."""

FOLDERS: Mapping[str, Callable[[], Callable[[Path], Any]]] = {
    "map.json": lambda: calibration.VibrationMap.load,
    "study.toml": lambda: acquisition.load_study,
    "experiment.toml": lambda: owned("folder experiment"),
}
"""Gives what reads a folder that holds a file of this name."""


def read_result(kind: str, path: Path) -> Any:
    """Read a file of a kind of `RESULTS`. Raises DataError for a damaged one."""
    result = RESULTS[kind]()
    return result.open(path) if kind == "recording" else result.load(path)


@overload
def load(path: str | os.PathLike[str]) -> Any: ...
@overload
def load(path: Iterable[str | os.PathLike[str]]) -> list[Any]: ...
def load(path: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> Any:
    """Load what haploop wrote to `path`, or to each of several paths.

    A `Recording`, `Representative`, `Calibration`, `Waveforms`, `ButtonPlan`, `Drive`, `Check`,
    `DigitalButton` or `Curve` (.h5), a `VibrationMap` (the folder), a `Study` or an `Experiment` (the
    folder, or its .toml file).
    Raises DataError for what is missing, damaged, or nothing of these.

    For example:

        >>> haploop.load("press.h5").button
        'latch'
    """
    if not isinstance(path, str | os.PathLike):
        return [load(one) for one in path]
    one = Path(path)
    for name, read in FOLDERS.items():
        if one.name == name:
            one = one.parent
        if (one / name).is_file():
            return read()(one)
    if one.is_dir():
        raise DataError(f"{one} is a folder without {', '.join(FOLDERS)}: name a file in it.")
    kind = hdf5.kind_of(one)
    if kind not in RESULTS:
        raise DataError(f"{one} holds a {kind}, which cannot be loaded by itself.")
    return read_result(kind, one)
