"""Values on disk: HDF5, written whole or not at all, never over another file.

A dataclass becomes a group: arrays are datasets, everything else is an attribute (tuples as JSON),
and a dataclass within it is a group of its own, or one for each in a tuple of them. The root's
attributes say what the file is, which version of haploop wrote it, and the content's hash, so that a
damaged file is told from a whole one.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import re
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import h5py
import numpy as np
from numpy.typing import NDArray

from haploop.instruments import DataError

__all__ = ["Flat", "digest", "flatten", "new_file", "os_error_text", "read", "restore", "write"]

Flat = dict[str, NDArray[Any] | float | int | bool | str]
"""A dataclass as names with slashes and plain values."""
Value = TypeVar("Value")

FORMAT = 1


def flatten(value: Any, prefix: str = "") -> Flat:
    """A dataclass of arrays, numbers, strings, tuples and such dataclasses, as a flat mapping."""
    flat: Flat = {}
    for field in dataclasses.fields(value):
        item, name = getattr(value, field.name), prefix + field.name
        if dataclasses.is_dataclass(item):
            flat |= flatten(item, name + "/")
        elif isinstance(item, tuple) and item and dataclasses.is_dataclass(item[0]):
            for number, member in enumerate(item):
                flat |= flatten(member, f"{name}/{number:04d}/")
            flat[name + "/count"] = len(item)
        else:
            # What HDF5 has no attribute for is JSON.
            written = item is None or isinstance(item, tuple | dict)
            flat[name] = json.dumps(item) if written else _plain(item)
    return flat


def digest(flat: Flat) -> str:
    """SHA-256 of the names and values, independent of how the file lays them out."""
    sha = hashlib.sha256()
    for name, value in sorted(flat.items()):
        sha.update(f"{name}\0".encode())
        if isinstance(value, np.ndarray):
            sha.update(np.ascontiguousarray(value).tobytes())
        else:
            sha.update(repr(value).encode())
    return sha.hexdigest()


def restore(kind: type[Value], flat: Flat, path: str | Path, prefix: str = "") -> Value:
    """The dataclass that `flatten` made `flat` from. Raises DataError when something is missing."""
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        key = prefix + name
        if dataclasses.is_dataclass(hint):
            values[name] = restore(hint, flat, path, key + "/")  # type: ignore[arg-type]
        elif f"{key}/count" in flat:
            member = get_args(hint)[0]
            numbers = range(int(flat[f"{key}/count"]))
            values[name] = tuple(restore(member, flat, path, f"{key}/{n:04d}/") for n in numbers)
        elif key not in flat:
            raise DataError(f"{path} holds no {key!r}: it was not written by this version of haploop.")
        elif get_origin(hint) in (tuple, Mapping, UnionType):
            values[name] = _tuples(json.loads(str(flat[key])))
        else:
            values[name] = flat[key]
    return kind(**values)


@contextmanager
def new_file(path: str | Path) -> Iterator[Path]:
    """A name to write to beside `path`; on leaving, what was written there becomes `path`, whole.

    Left by an exception, nothing remains. Raises DataError when `path` exists or cannot be written.
    """
    path = Path(path)
    if path.exists():
        raise DataError(f"{path} exists, and what was measured is never overwritten: choose another name.")
    part = path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")
    try:
        yield part
        with part.open("rb+") as whole:
            os.fsync(whole.fileno())
        _publish(part, path)
    except (OSError, RuntimeError) as error:
        raise DataError(f"{path} cannot be written: {os_error_text(error)}.") from None
    finally:
        part.unlink(missing_ok=True)


def write(path: str | Path, kind: str, flat: Flat) -> None:
    """Write a new file of a kind. Raises DataError when `path` exists or cannot be written."""
    with new_file(path) as part, h5py.File(part, "x") as file:
        file.attrs.update(
            kind=f"haploop {kind}",
            format=FORMAT,
            software=f"haploop {metadata.version('haploop')}",
            content=digest(flat),
        )
        for name, value in flat.items():
            if isinstance(value, np.ndarray):
                file.create_dataset(name, data=value)
            else:
                group, _, own = name.rpartition("/")
                file.require_group(group or "/").attrs[own] = value


def read(path: str | Path, kind: str) -> Flat:
    """What `write` wrote. Raises DataError: not there, not of this kind, or damaged."""
    if not Path(path).is_file():
        raise DataError(f"There is no file {path}.")
    flat: Flat = {}

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            flat[name] = item[()]
        else:
            flat.update({f"{name}/{key}": _plain(value) for key, value in item.attrs.items()})

    try:
        with h5py.File(path, "r") as file:
            root = {key: _plain(value) for key, value in file.attrs.items()}
            file.visititems(visit)
    except (OSError, KeyError, RuntimeError, ValueError):
        raise DataError(f"{path} is damaged or no HDF5 file: it cannot be read.") from None
    labels = {key: root.pop(key, None) for key in ("kind", "format", "software", "content")}
    if labels["kind"] != f"haploop {kind}":
        raise DataError(f"{path} is no haploop {kind} (it says {labels['kind']!r}).")
    if labels["format"] != FORMAT:
        raise DataError(
            f"{path} has format {labels['format']} and this version reads {FORMAT}: "
            f"it was written by {labels['software']}."
        )
    flat |= root
    if labels["content"] != digest(flat):
        raise DataError(f"{path} is damaged: its content does not match its hash.")
    return flat


def os_error_text(error: OSError | RuntimeError) -> str:
    """The operating system's message for a file that could not be read or written.

    The HDF5 library's own text is full of addresses and offsets, and of its errors not all carry a
    number: what it says when closing a file on a full disk names one in the text only.
    """
    said = re.search(r"errno = (\d+)", str(error))
    number = getattr(error, "errno", None) or (int(said[1]) if said else None)
    return os.strerror(number) if number else "the disk may be full"


def _publish(part: Path, path: Path) -> None:
    """Give the finished file its name, without replacing a file that has come to be meanwhile."""
    try:
        os.link(part, path)
    except FileExistsError:
        raise
    except OSError:
        # A file system without hard links. On Windows rename refuses to replace, as required.
        part.rename(path)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
