"""What a binary file holds, read in a process of its own: a library may crash on a damaged file.

MATLAB files of both kinds, HDF5, NumPy's, TDMS and workbooks, told apart by their first bytes. All are taken
as a tree of arrays, numbers and texts under dotted names; a workbook as rows of cells.
"""

from __future__ import annotations

import io
import json
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...acquisition.own_process import allow_memory, answer_of
from ...instruments import ConfigurationError, DataError
from ...instruments.extras import optional
from ...instruments.files import os_error_text

_PACE = 1 << 26
"""Bytes of a file for which its reader has another minute."""
_PACKED = 100
"""Bytes of memory to read a byte of a file, which may be compressed."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MOST = 1000
"""Arrays, numbers and texts that are taken of one file."""


@dataclass
class Tree:
    """Arrays, numbers and texts of a file, by dotted name; or the rows of a workbook's sheet."""

    kind: str = ""
    arrays: dict[str, Any] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    lists: dict[str, list[str]] = field(default_factory=dict)
    """Lists of texts: names or units of an array's columns."""
    rows: list[list[str]] = field(default_factory=list)


def tree_of(path: Path) -> Tree:
    """What a file holds. Raises DataError, ConfigurationError where a package is missing."""
    try:
        with np.load(io.BytesIO(answer_of(__name__, path, pace=_PACE)), allow_pickle=False) as found:
            said = json.loads(str(found["said"]))
            arrays = {name: found[f"a{number}"] for number, name in enumerate(said.pop("names", []))}
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_error_text(error)}.") from None
    except (ValueError, LookupError, EOFError, zipfile.BadZipFile):
        raise DataError(f"{path} cannot be read: it is damaged, or larger than the memory.") from None
    if said.get("missing"):
        raise ConfigurationError(said["missing"])
    if said["error"]:
        raise DataError(f"{path} is no {said['kind'] or 'file that haploop knows'} ({said['error']}).")
    said.pop("error"), said.pop("missing")
    return Tree(arrays=arrays, **said)


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
        "rows": tree.rows, "names": list(tree.arrays), "error": error, "missing": missing,
    }  # fmt: skip
    arrays = {f"a{number}": values for number, values in enumerate(tree.arrays.values())}
    np.savez(sys.stdout.buffer, said=np.array(json.dumps(said)), **arrays)


def _read(path: Path, tree: Tree) -> None:
    with path.open("rb") as file:
        head = file.read(1 << 12)
    if _HDF5 in head:
        _hdf5(path, tree, matlab=head.startswith(b"MATLAB"))
    elif head.startswith(b"TDSm"):
        _tdms(path, tree)
    elif head.startswith(b"\x93NUMPY"):
        tree.kind = "NumPy file"
        _add(tree, "", np.load(path, allow_pickle=False))
    elif head.startswith(b"PK"):
        with zipfile.ZipFile(path) as archive:
            book = any(name.startswith("xl/") for name in archive.namelist())
        if book:
            _sheet(path, tree)
        else:
            tree.kind = "NumPy archive"
            with np.load(path, allow_pickle=False) as found:
                for name in found.files:
                    _add(tree, name, found[name])
    else:
        import scipy  # noqa: PLC0415 - a second, for MATLAB's files only

        tree.kind = "MATLAB file of level 5"
        content = scipy.io.loadmat(path, squeeze_me=True, simplify_cells=True)
        for name, value in content.items():
            if not name.startswith("__"):
                _add(tree, name, value)


def _add(tree: Tree, name: str, value: Any) -> None:
    """Enter a value, and what is in it."""
    if len(tree.arrays) + len(tree.numbers) + len(tree.texts) >= _MOST:
        return
    if isinstance(value, Mapping):
        for key, one in value.items():
            _add(tree, f"{name}.{key}" if name else str(key), one)
        return
    if isinstance(value, bytes | str | np.bytes_ | np.str_):
        tree.texts[name] = (value.decode(errors="replace") if isinstance(value, bytes) else str(value))[:1000]
        return
    array = np.asarray(value)
    if array.dtype.names:
        for key in array.dtype.names:
            _add(tree, f"{name}.{key}" if name else key, array[key])
    elif array.dtype.kind in "SUO" and array.size and all(isinstance(v, str | bytes) for v in array.flat):
        tree.lists[name] = [v.decode(errors="replace") if isinstance(v, bytes) else v for v in array.flat]
    elif array.dtype.kind == "O" and array.ndim == 1 and all(isinstance(v, Mapping) for v in array):
        for number, one in enumerate(array):
            _add(tree, f"{name}.{number}", one)
    elif array.dtype.kind in "iufb":
        array = np.squeeze(array)
        if array.ndim == 0:
            tree.numbers[name] = float(array)
        elif array.ndim <= 2 and array.size > 1:
            tree.arrays[name or "column"] = array.astype(np.float64)


def _hdf5(path: Path, tree: Tree, matlab: bool) -> None:
    import h5py  # noqa: PLC0415 - as scipy above

    tree.kind = "MATLAB file of level 7.3" if matlab else "HDF5 file"
    with h5py.File(path, "r") as file:

        def entered(name: str, one: Any) -> None:
            dotted = name.replace("/", ".")
            for key, value in one.attrs.items():
                if not key.startswith("MATLAB"):
                    _add(tree, f"{dotted}.{key}", value)
            if isinstance(one, h5py.Dataset) and not name.startswith("#refs#"):
                if one.attrs.get("MATLAB_class") == b"char":
                    tree.texts[dotted] = "".join(map(chr, np.asarray(one[()]).T.ravel()))[:1000]
                else:
                    _add(tree, dotted, one.asstr()[()] if h5py.check_string_dtype(one.dtype) else one[()])

        for key, value in file.attrs.items():
            _add(tree, str(key), value)
        file.visititems(entered)


def _tdms(path: Path, tree: Tree) -> None:
    tree.kind = "TDMS file"
    nptdms = optional("nptdms", "files", "A TDMS file")
    with nptdms.TdmsFile.open(path) as file:
        channels = [channel for group in file.groups() for channel in group.channels()]
        several = len({channel.group_name for channel in channels}) > 1
        for key, value in file.properties.items():
            _add(tree, str(key), _plain(value))
        for channel in channels:
            name = f"{channel.group_name}.{channel.name}" if several else channel.name
            values = channel[:]
            if np.asarray(values).dtype.kind == "M":
                values = (values - values[0]) / np.timedelta64(1, "s")
                tree.texts[f"{name}.stamps"] = "yes"
            _add(tree, name, values)
            for key, value in channel.properties.items():
                _add(tree, f"{name}.{key}", _plain(value))


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, np.datetime64) else value


def _sheet(path: Path, tree: Tree) -> None:
    """The sheet with the most rows."""
    tree.kind = "workbook"
    book = optional("openpyxl", "files", "A workbook").load_workbook(path, read_only=True, data_only=True)
    for sheet in book.worksheets:
        rows = [[_text(cell) for cell in row] for row in sheet.iter_rows(values_only=True)]
        if len(rows) > len(tree.rows):
            tree.rows, tree.texts["sheet"] = rows, str(sheet.title)


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    if hasattr(cell, "isoformat"):
        return str(cell.isoformat(sep=" ") if hasattr(cell, "date") else cell.isoformat())
    return repr(cell) if isinstance(cell, float) else str(cell)
