"""Load any file or folder that haploop writes, as the object that it holds."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, overload

from ..acquisition import Recording, Representative, load_study
from ..base import hdf5
from ..base.errors import DataError
from ..calibration import ButtonPlan, Calibration, Check, DigitalButton, Drive, Waveforms
from ..calibration.map import VibrationMap
from ..experiments import load_experiment
from .curve import Curve

RESULTS: Mapping[str, tuple[type, Callable[[Path], Any]]] = {
    "recording": (Recording, Recording.open),
    "representative": (Representative, Representative.load),
    "calibration": (Calibration, Calibration.load),
    "waveforms": (Waveforms, Waveforms.load),
    "drive": (Drive, Drive.load),
    "check": (Check, Check.load),
    "button": (DigitalButton, DigitalButton.load),
    "map": (VibrationMap, VibrationMap.load),
    "plan": (ButtonPlan, ButtonPlan.load),
    "curve": (Curve, Curve.load),
}
"""The class of each kind of result, and the function that reads it."""

_FOLDERS = {"map.json": VibrationMap.load, "study.toml": load_study, "experiment.toml": load_experiment}


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
    for name, read in _FOLDERS.items():
        if one.name == name:
            one = one.parent
        if (one / name).is_file():
            return read(one)
    if one.is_dir():
        raise DataError(f"{one} is a folder without {', '.join(_FOLDERS)}: name a file in it.")
    kind = hdf5.kind_of(one)
    if kind not in RESULTS:
        raise DataError(f"{one} holds a {kind}, which cannot be loaded by itself.")
    return RESULTS[kind][1](one)
