"""Formats that signals are read from."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...base.errors import ConfigurationError, DataError
from .. import sep005_file, wav_file
from ..views import Signals
from . import text_file, tree_table, uff_signals
from .start_times import instant
from .table import Column, Stated, Table
from .units import contradiction, doubt_among, is_time, unit_of

_SIGNALS: Mapping[str, Callable[[Path, float | None], Signals]] = {
    "wav": wav_file.read_signals,
    "sep005": sep005_file.read_signals,
}
_TREES = ("mat", "hdf5", "netcdf", "nwb", "numpy", "parquet", "tdms", "xdf", "xlsx")
FORMATS = ("csv", "wav", *_TREES, "uff", "sep005")
"""What a file can be read as."""
_SUFFIXES = {
    ".csv": "csv", ".tsv": "csv", ".txt": "csv", ".lvm": "csv", ".asc": "csv", ".dat": "csv", ".wav": "wav",
    ".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".hdf": "hdf5", ".nc": "netcdf", ".nwb": "nwb",
    ".parquet": "parquet", ".xdf": "xdf", ".npy": "numpy", ".npz": "numpy",
    ".tdms": "tdms", ".xlsx": "xlsx", ".uff": "uff", ".unv": "uff", ".sep005": "sep005", ".json": "sep005",
}  # fmt: skip
"""Format by the end of a file's name, where nobody states it."""


_FREQUENCY = re.compile(r"fr[eé]quen[cz]\w*|frecuencia\w*|freq\.?", re.I)


def format_of(path: Path, format: str | None) -> str:
    """The format of a file, which `format` names or its name ends in. Raises ConfigurationError."""
    if path.is_dir():
        raise ConfigurationError(f"{path} is a folder: name a file in it.")
    found = _SUFFIXES.get(path.suffix.lower(), "") if format is None else format
    if found not in FORMATS:
        problem = (
            f"has an unknown file type {path.suffix!r}" if format is None else f"cannot be read as {format!r}"
        )
        raise ConfigurationError(
            f"{path} {problem}: haploop imports {', '.join(_SUFFIXES)}, and files of other names as one of "
            f"{', '.join(FORMATS)} (--from)."
        )
    return found


def read_table(path: Path, format: str | None, decimal: str | None, skip: bool = False) -> Table:
    """The columns of a file, without damaged rows of a text if `skip`.

    Raises ConfigurationError, DataError.
    """
    found = format_of(path, format)
    if not path.is_file():
        raise DataError(f"There is no file {path}: check the name.")
    of = path.stat()
    return _read(path, found, decimal, skip, (of.st_mtime_ns, of.st_size, of.st_ino))


@lru_cache(maxsize=1)  # a file is read again for each answer, and for each measurement that it holds
def _read(path: Path, found: str, decimal: str | None, skip: bool, _state: tuple[int, int, int]) -> Table:
    with np.errstate(all="ignore"):  # what is not finite is missing, and said
        if found in _SIGNALS:
            table = _of_signals(path, _SIGNALS[found](path, None), found)
        elif found == "uff":
            table = uff_signals.read_table(path)
        elif found in _TREES:
            table = tree_table.read_table(path, decimal, skip)
        else:
            table = text_file.read_table(path, decimal, skip)
    if any(map(_is_frequency, table.columns)):
        raise DataError(
            f"{path} is over frequency: of responses haploop imports UFF files, complex arrays (MATLAB, "
            "HDF5, NumPy), and what it exported itself, a CSV file with its sidecar."
        )
    if not all(len(column.values) for column in table.columns):
        raise DataError(f"{path} is empty.")
    factor = doubt_among(table.columns)
    columns = tuple(
        replace(
            column,
            values=np.where(np.isfinite(column.values), column.values, np.nan),
            doubt=column.doubt
            or contradiction(column.name, column.unit)
            or ("" if column.stamps or is_time(column.name, column.unit) else factor),
        )
        for column in table.columns
    )
    return replace(table, columns=columns)


def _is_frequency(column: Column) -> bool:
    """True for an axis of frequencies: such a column, rising throughout."""
    called = _FREQUENCY.fullmatch(column.name) or unit_of(column.unit, "rate") is not None
    return bool(called and np.all(np.diff(column.values) > 0))


def _of_signals(path: Path, signals: Signals, format: str) -> Table:
    columns = tuple(Column(c.name, c.unit, c.values) for c in signals.channels)
    kind = {"wav": "WAV", "sep005": "SEP-005"}[format]
    stated = (Stated(signals.rate_hz, "the file's own rate"),)
    start = instant(str(signals.about.get("start_timestamp", "")))
    return Table(path, kind, columns, stated, signals.about, starts=() if start is None else ((0, start),))
