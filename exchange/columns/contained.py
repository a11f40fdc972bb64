"""What a binary file holds, read in a process of its own: a library may crash on a damaged file.

Told apart by their first bytes. Files whose channels say for themselves what they are (TDMS, XDF, Parquet,
classic netCDF, NWB) are taken as columns; MATLAB's, HDF5 and NumPy's as a tree of arrays, numbers and texts
under dotted names; a workbook as rows of cells.
"""

from __future__ import annotations

import io
import json
import os
import sys
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ...base.entry_points import optional
from ...base.errors import ConfigurationError, DataError
from ...base.files import os_error_text
from ...base.own_process import allow_memory, answer_of
from . import channel_files, hdf5_tree, workbook
from .start_times import Start
from .table import Column

_PACE = 1 << 26
"""Bytes of a file for which its reader has another minute."""
_PACKED = 100
"""Bytes of memory to read a byte of a file, which may be compressed."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MOST = 1000
"""Arrays, numbers and texts that are taken of one file."""


@dataclass
class Tree:
    """Columns of a file; or its arrays, numbers and texts, by dotted name; or rows of a workbook."""

    kind: str = ""
    columns: list[Column] = field(default_factory=list)
    arrays: dict[str, Any] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    lists: dict[str, list[str]] = field(default_factory=dict)
    """Lists of texts: names or units of an array's columns."""
    rows: list[list[str]] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    """Names of what is none of these, and was left out."""


def tree_of(path: Path) -> Tree:
    """What a file holds. Raises DataError, ConfigurationError where a package is missing."""
    try:
        of = path.stat()
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_error_text(error)}.") from None
    return _tree(path, (of.st_mtime_ns, of.st_size, of.st_ino))


@lru_cache(maxsize=1)  # a file is looked at for responses first, then for signals
def _tree(path: Path, _state: tuple[int, int, int]) -> Tree:
    try:
        with np.load(io.BytesIO(answer_of(__name__, path, pace=_PACE)), allow_pickle=False) as found:
            said = json.loads(str(found["said"]))
            arrays = {name: found[f"a{number}"] for number, name in enumerate(said.pop("names", []))}
            columns = [
                Column(
                    **own, values=found[f"c{number}"], times=found[f"t{number}"] if has_times else None,
                    since=_since(since),
                )
                for number, (own, has_times, since) in enumerate(said.pop("columns", []))
            ]  # fmt: skip
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_error_text(error)}.") from None
    except (ValueError, LookupError, EOFError, zipfile.BadZipFile):
        raise DataError(f"{path} cannot be read: it is damaged, or larger than the memory.") from None
    if said.get("missing"):
        raise ConfigurationError(said["missing"])
    if said["error"]:
        raise DataError(f"{path} is no {said['kind'] or 'file that haploop knows'} ({said['error']}).")
    said.pop("error"), said.pop("missing")
    return Tree(arrays=arrays, columns=columns, **said)


def _in_child() -> None:
    path = Path(sys.argv[1])
    tree, error, missing = Tree(), "", ""
    try:
        allow_memory(_PACKED * path.stat().st_size)
        _read(path, tree)
    except ConfigurationError as absent:
        missing = str(absent)
    except Exception as wrong:  # of a damaged file nearly any: the libraries have no common base
        error = " ".join(str(wrong or type(wrong).__name__).split())[:200].rstrip(".")
    said = {
        "kind": tree.kind, "numbers": tree.numbers, "texts": tree.texts, "lists": tree.lists,
        "rows": tree.rows, "left": tree.left, "names": list(tree.arrays), "error": error, "missing": missing,
        "columns": [
            (_labels(one), one.times is not None, one.since and (one.since.words, str(one.since.at or "")))
            for one in tree.columns
        ],
    }  # fmt: skip
    arrays = {f"a{number}": values for number, values in enumerate(tree.arrays.values())}
    for number, one in enumerate(tree.columns):
        arrays[f"c{number}"] = one.values
        if one.times is not None:
            arrays[f"t{number}"] = one.times
    np.savez(sys.stdout.buffer, said=np.array(json.dumps(said)), **arrays)


def _labels(column: Column) -> dict[str, Any]:
    kept = ("name", "unit", "rate_hz", "stamps", "start_s", "also", "doubt")
    return {key: getattr(column, key) for key in kept}


def _since(said: list[str] | None) -> Start | None:
    if said is None:
        return None
    return Start(said[0], datetime.fromisoformat(said[1]) if said[1] else None)


def _read(path: Path, tree: Tree) -> None:
    with path.open("rb") as file:
        head = file.read(1 << 12)
    if _HDF5 in head:
        tree.kind = "HDF5 file"
        tree.kind = hdf5_tree.read(
            path, head.startswith(b"MATLAB"), partial(_add, tree), tree.texts, tree.columns
        )
        return
    for start, kind, read in _KINDS:
        if head.startswith(start):
            tree.kind = kind
            read(path, tree)
            return
    if head[126:128] not in (b"IM", b"MI") and path.suffix.lower() != ".mat":
        tree.kind = "file of a known kind"
        raise ValueError("it begins as none of HDF5, MATLAB, NumPy, TDMS, XDF, Parquet, netCDF and workbooks")
    import scipy  # noqa: PLC0415 - a second, for MATLAB's files only

    tree.kind = "MATLAB file of level 5"
    content = scipy.io.loadmat(path, squeeze_me=True, simplify_cells=True)
    for name, value in content.items():
        if not name.startswith("__"):
            _add(tree, name, value)


def _tdms(path: Path, tree: Tree) -> None:
    tree.columns += channel_files.tdms(path, tree.left)


def _xdf(path: Path, tree: Tree) -> None:
    tree.columns, tree.texts["datetime"] = channel_files.xdf(path)


def _parquet(path: Path, tree: Tree) -> None:
    # Its own allocator reserves a gigabyte of addresses, and the library 200 MB, before a byte is read.
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"
    optional("pyarrow.parquet", "parquet", "A Parquet file")
    allow_memory(_PACKED * path.stat().st_size)
    tree.columns, about, texts = channel_files.parquet(path)
    _enter(tree, about, texts)


def _netcdf(path: Path, tree: Tree) -> None:
    tree.columns, about, beside = channel_files.netcdf(path)
    _enter(tree, about, beside)


def _numpy(path: Path, tree: Tree) -> None:
    _add(tree, "", np.load(path, allow_pickle=False))


def _zip(path: Path, tree: Tree) -> None:
    with zipfile.ZipFile(path) as archive:
        book = any(name.startswith("xl/") for name in archive.namelist())
    if book:
        tree.rows, tree.texts["sheet"], tree.lists["sheets"] = workbook.read(path)
        return
    tree.kind = "NumPy archive"
    with np.load(path, allow_pickle=False) as found:
        for name in found.files:
            _add(tree, name, found[name])


def _enter(tree: Tree, about: Mapping[str, Any], beside: Mapping[str, Any]) -> None:
    """What a file says of itself, and its arrays of responses."""
    _add(tree, "about", about)
    for name, value in beside.items():
        _add(tree, name, value)


def _add(tree: Tree, name: str, value: Any) -> None:
    """Enter a value, and what is in it."""
    if len(tree.arrays) + len(tree.numbers) + len(tree.texts) >= _MOST or value is None:
        return
    if isinstance(value, Mapping):
        for key, one in value.items():
            _add(tree, f"{name}.{key}" if name else str(key), one)
    elif isinstance(value, bytes | str | np.bytes_ | np.str_):
        tree.texts[name] = (value.decode(errors="replace") if isinstance(value, bytes) else str(value))[:1000]
    else:
        _add_array(tree, name, np.asarray(value))


def _add_array(tree: Tree, name: str, array: Any) -> None:
    if array.dtype.names:
        for key in array.dtype.names:
            _add(tree, f"{name}.{key}" if name else key, array[key])
    elif array.dtype.kind in "SUO" and array.size and all(isinstance(v, str | bytes) for v in array.flat):
        tree.lists[name] = [v.decode(errors="replace") if isinstance(v, bytes) else v for v in array.flat]
    elif array.dtype.kind == "O" and array.ndim == 1 and all(isinstance(v, Mapping) for v in array):
        for number, one in enumerate(array):
            _add(tree, f"{name}.{number}", one)
    elif array.dtype.kind in "iufbc" and (array := np.squeeze(array)).ndim <= 2:
        if array.ndim == 0:
            tree.numbers[name] = float(array.real)
        elif array.size > 1:
            kind = np.complex128 if array.dtype.kind == "c" else np.float64
            tree.arrays[name or "column"] = array.astype(kind)
    elif array.size > 1:
        tree.left.append(name or "array")


_KINDS: tuple[tuple[bytes, str, Callable[[Path, Tree], None]], ...] = (
    (b"TDSm", "TDMS file", _tdms),
    (b"XDF:", "XDF file", _xdf),
    (b"PAR1", "Parquet file", _parquet),
    (b"CDF", "netCDF file of the classic format", _netcdf),
    (b"\x93NUMPY", "NumPy file", _numpy),
    (b"PK", "workbook", _zip),
)
"""First bytes, name and reader of a kind of file."""
