"""HDF5 files as a tree: MATLAB 7.3, netCDF 4, NWB and others. Runs in `contained`'s process.

Conventions by which a file states what its numbers mean are applied where they stand: `scale_factor`,
`add_offset`, `_FillValue`, `missing_value` and `valid_range` (CF conventions 1.11, chapters 2.5 and 8.1;
netCDF User's Guide, appendix A), `conversion` and `offset` (NWB 2, TimeSeries). Nothing outside of the file
is read: whoever sends a file could otherwise have another file copied into what is then shared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .start_times import instant
from .table import Column

Enter = Callable[[str, Any], None]
_DATES_OF_NWB = ("timestamps_reference_time", "session_start_time")
"""The zero of all its clocks, which is the start of the session where it is not stated."""
_OF_NWB = {"conversion": "scale_factor", "offset": "add_offset"}
CF = ("scale_factor", "add_offset", "_FillValue", "missing_value", "valid_range", "valid_min", "valid_max")
"""Attributes that are used up here."""


def read(path: Path, matlab: bool, enter: Enter, texts: dict[str, str], columns: list[Column]) -> str:
    """Enter arrays, numbers and texts by dotted name, or add columns; the kind of file.

    Raises ValueError for a file that keeps its values in another one.
    """
    import h5py  # noqa: PLC0415 - for HDF5 files only

    with h5py.File(path, "r") as file:
        if "nwb_version" in file.attrs:
            columns += _series(file)
            return "NWB file"
        for key, value in file.attrs.items():
            enter(str(key), _plain(value))
        for name, one in _inside(file):
            dotted = name.replace("/", ".")
            packed = {key: one.attrs[key] for key in one.attrs if key in CF}
            for key, value in one.attrs.items():
                if key not in packed and not key.startswith("MATLAB") and key not in _STRUCTURE:
                    enter(f"{dotted}.{key}", _plain(value))
            if not isinstance(one, h5py.Dataset) or name.startswith("#refs#") or _is_length(one):
                continue
            if one.attrs.get("MATLAB_class") == b"char":
                texts[dotted] = "".join(map(chr, np.asarray(one[()]).T.ravel()))[:1000]
            elif h5py.check_string_dtype(one.dtype) and one.shape is not None:
                enter(dotted, _plain(one.asstr()[()]))
            elif one.shape is not None:
                enter(dotted, unpacked(one[()], packed))
                if labels := _labels(one):
                    leaf = dotted.rpartition(".")[2]
                    enter(f"{dotted}.names", [f"{leaf} {label}" for label in labels])
        return "MATLAB file of level 7.3" if matlab else "HDF5 file"


_STRUCTURE = ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "_Netcdf4Dimid", "_Netcdf4Coordinates")


def _is_length(one: Any) -> bool:
    """True for what netCDF 4 writes for a dimension without coordinates: its length, and zeros."""
    return "This is a netCDF dimension but not" in str(_plain(one.attrs.get("NAME", "")))


def unpacked(values: Any, said: Mapping[str, Any]) -> Any:
    """Values as their attributes say: what is missing is NaN, and integers become what they stand for."""
    raw = np.asarray(values)
    if raw.dtype.kind not in "iuf" or not said:
        return values
    missing = np.zeros(raw.shape, dtype=bool)
    for key in ("_FillValue", "missing_value"):
        for mark in np.ravel(np.asarray(said[key])) if key in said else ():
            missing |= raw == mark
    low, high = np.ravel(said["valid_range"])[:2] if "valid_range" in said else (None, None)
    low, high = _one(said, "valid_min", low), _one(said, "valid_max", high)
    if low is not None:
        missing |= raw < low
    if high is not None:
        missing |= raw > high
    scale, offset = float(_one(said, "scale_factor", 1.0)), float(_one(said, "add_offset", 0.0))
    found = raw.astype(np.float64) * scale + offset
    return np.where(missing, np.nan, found)


def _labels(one: Any) -> list[str]:
    """Texts of the coordinate along a matrix's other dimension, as xarray writes x, y, z; none without."""
    import h5py  # noqa: PLC0415 - for HDF5 files only

    if len(one.shape) != 2 or "DIMENSION_LIST" not in one.attrs:
        return []
    scales = (scale for dimension in one.dims for scale in dimension.values())
    texts = (scale.asstr()[()] for scale in scales if h5py.check_string_dtype(scale.dtype))
    return next(([str(text) for text in np.atleast_1d(found)] for found in texts), [])


def _one(said: Mapping[str, Any], key: str, otherwise: Any) -> Any:
    return np.ravel(said[key])[0] if key in said else otherwise


def _inside(group: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Each group and dataset below, by its path. Raises ValueError for what lies in another file."""
    import h5py  # noqa: PLC0415

    for key in group:
        link, name = group.get(key, getlink=True), f"{above}{key}"
        if isinstance(link, h5py.ExternalLink):
            raise ValueError(f"{name} is a link to another file: {_OUTSIDE}")
        if isinstance(link, h5py.SoftLink):
            continue
        one = group[key]
        if isinstance(one, h5py.Dataset) and (one.is_virtual or one.external):
            raise ValueError(f"{name} has its values in another file: {_OUTSIDE}")
        yield name, one
        if isinstance(one, h5py.Group):
            yield from _inside(one, f"{name}/")


_OUTSIDE = "export the values themselves into one file"


def _plain(value: Any) -> Any:
    """An attribute or a dataset of one text as this text."""
    array: NDArray[Any] = np.asarray(value)
    if array.dtype.kind in "SUO" and array.size == 1:
        return array.ravel()[0]
    return value


def _series(file: Any) -> Iterator[Column]:
    """The columns of each TimeSeries of an NWB file, on the session's clock."""
    import h5py  # noqa: PLC0415

    dates = {name: one for name, one in _inside(file) if name in _DATES_OF_NWB}
    since = next((instant(str(dates[name].asstr()[()])) for name in _DATES_OF_NWB if name in dates), None)
    for name, one in _inside(file):
        data = one.get("data") if isinstance(one, h5py.Group) else None
        if (
            "neurodata_type" not in one.attrs
            or not isinstance(data, h5py.Dataset)
            or data.dtype.kind not in "iuf"
        ):
            continue
        values = np.atleast_1d(
            unpacked(data[()], {_OF_NWB[k]: data.attrs[k] for k in _OF_NWB if k in data.attrs})
        )
        unit = str(_plain(data.attrs.get("unit", "")))
        start, stamps = one.get("starting_time"), one.get("timestamps")
        rate = None if start is None else float(start.attrs["rate"])
        if "channel_conversion" in one and values.ndim == 2:
            values = values * one["channel_conversion"][()]
        for number, column in enumerate(values.T if values.ndim == 2 else [values]):
            if values.ndim > 2 or len(column) < 2:
                continue
            heading = name.rpartition("/")[2]
            yield Column(
                heading if values.ndim == 1 else f"{heading} {number}",
                "" if unit in ("n.a.", "unknown") else unit,
                np.ascontiguousarray(column, dtype=np.float64),
                rate,
                start_s=None if start is None else float(start[()]),
                since=since,
                times=None if stamps is None else np.asarray(stamps[()], dtype=np.float64),
            )
