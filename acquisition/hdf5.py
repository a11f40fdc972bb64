"""Store dataclasses as HDF5 files: written whole, never over another file, verified when read.

A dataclass becomes a group: arrays are datasets, everything else is an attribute (tuples as JSON).
A nested dataclass is a subgroup; a tuple of dataclasses is one subgroup for each member. The root's
attributes state the kind of file (`format`, `format_version`), the version of haploop that wrote it
(`software`), and the content's hash (`content_hash`), which is recomputed on every load.

The bytes are compared with a SHA-256 in the file's user block before the HDF5 library reads them: that
library can crash on a damaged file (within 1000 random changes of a byte in metadata, measured).
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
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
from haploop.instruments.files import new_file

__all__ = ["Flat", "content_hash", "digest", "flatten", "is_stored", "kind_of", "read", "restore", "write"]

Flat = dict[str, NDArray[Any] | float | int | bool | str]
"""A dataclass flattened to plain values, with slashes in the names of nested fields."""
Value = TypeVar("Value")

VERSION = 1
_LABELS = ("format", "format_version", "software", "content_hash")
_SEAL = b"haploop, SHA-256 of what follows this block: "
_USER_BLOCK = 512
"""Bytes before the HDF5 data, which its readers skip; the smallest that HDF5 allows."""
_UNREADABLE = (
    OSError, KeyError, RuntimeError, ValueError, TypeError, AttributeError, OverflowError, MemoryError,
)  # fmt: skip
"""Exceptions that h5py raises for a damaged file."""


def flatten(value: Any, prefix: str = "") -> Flat:
    """Flatten a dataclass of arrays, numbers, strings, tuples and nested dataclasses to one mapping."""
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
            # HDF5 has no attribute type for these: they are stored as JSON.
            written = item is None or isinstance(item, tuple | dict)
            flat[name] = json.dumps(item) if written else _plain(item)
    return flat


def digest(flat: Flat) -> str:
    """SHA-256 of names, types, byte orders, shapes and values, independent of the file's layout."""
    sha = hashlib.sha256()
    for name, value in sorted(flat.items()):
        if isinstance(value, np.ndarray):
            # JSON delimits name, type and shape unambiguously.
            sha.update(json.dumps([name, value.dtype.str, value.shape]).encode() + b"\n")
            sha.update(np.ascontiguousarray(value).tobytes())
        else:
            sha.update(json.dumps([name, type(value).__name__, repr(value)]).encode() + b"\n")
    return sha.hexdigest()


def restore(kind: type[Value], flat: Flat, path: str | Path, prefix: str = "") -> Value:
    """Rebuild the dataclass from the mapping of `flatten`. Raises DataError when a field is missing."""
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        key = prefix + name
        nested = next((kind for kind in (hint, *get_args(hint)) if dataclasses.is_dataclass(kind)), None)
        if nested is not None and get_origin(hint) is not tuple and key not in flat:
            values[name] = restore(nested, flat, path, key + "/")  # type: ignore[arg-type]
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


def write(path: str | Path, kind: str, flat: Flat) -> None:
    """Write a new file of a kind. Raises DataError when `path` exists or cannot be written."""
    with new_file(path) as part:
        with h5py.File(part, "x", userblock_size=_USER_BLOCK) as file:
            file.attrs.update(
                format=f"haploop {kind}",
                format_version=VERSION,
                software=f"haploop {metadata.version('haploop')}",
                content_hash=digest(flat),
            )
            for name, value in flat.items():
                if isinstance(value, np.ndarray):
                    file.create_dataset(name, data=value)
                else:
                    group, _, own = name.rpartition("/")
                    file.require_group(group or "/").attrs[own] = value
        seal = _seal(part)
        with part.open("rb+") as raw:
            raw.write(seal)


def read(path: str | Path, kind: str) -> Flat:
    """Read a file of `write`. Raises DataError when it is missing, of another kind, or damaged."""
    with _opened(path) as file:
        flat: dict[str, Any] = {key: _plain(value) for key, value in file.attrs.items()}
        labels = {key: flat.pop(key, None) for key in _LABELS}
        if labels["format"] != f"haploop {kind}":
            raise DataError(f"{path} is not a haploop {kind}: it says {labels['format']!r}.")
        if None in labels.values():
            raise DataError(f"{path} is damaged: it does not state its version or its content's hash.")
        if labels["format_version"] != VERSION:
            raise DataError(
                f"{path} has format {labels['format_version']} and this version reads {VERSION}: "
                f"it was written by {labels['software']}."
            )
        flat |= _contents(file)
        if not _sealed(path) or labels["content_hash"] != digest(flat):
            raise DataError(f"{path} is damaged: its content does not match its hash.")
    return flat


def content_hash(path: str | Path) -> str:
    """Content hash stated in a file of any kind. Raises DataError."""
    with _opened(path) as file:
        return str(file.attrs["content_hash"])


def is_stored(path: str | Path) -> bool:
    """True when `write` wrote the file; it may still be damaged."""
    return Path(path).is_file() and _sealed(path)


def kind_of(path: str | Path) -> str:
    """Kind stated in a file: "recording", or a kind given to `write`. Raises DataError."""
    with _opened(path) as file:
        said = str(file.attrs.get("format", ""))
    if not said.startswith("haploop "):
        raise DataError(f"{path} was not written by haploop.")
    return said.removeprefix("haploop ")


@contextmanager
def _opened(path: str | Path) -> Iterator[h5py.File]:
    """Open a file for reading; raise DataError for the exceptions of h5py on a damaged file."""
    if not Path(path).is_file():
        raise DataError(f"There is no file {path}: check the name.")
    try:
        if _sealed(path) and _user_block(path) != _seal(path):
            raise DataError(f"{path} is damaged: its content does not match its hash.")
        with h5py.File(path, "r") as file:
            yield file
    except _UNREADABLE as error:
        if isinstance(error, PermissionError):
            raise DataError(f"You have no permission to read {path}: ask its owner.") from None
        raise DataError(f"{path} is damaged or no HDF5 file: it cannot be read.") from None


def _seal(path: str | Path) -> bytes:
    """Compute the user block of an intact file with this content."""
    with Path(path).open("rb") as file:
        file.seek(_USER_BLOCK)
        return _SEAL + hashlib.file_digest(file, "sha256").hexdigest().encode().ljust(
            _USER_BLOCK - len(_SEAL)
        )


def _sealed(path: str | Path) -> bool:
    return _user_block(path).startswith(_SEAL)


def _user_block(path: str | Path) -> bytes:
    with Path(path).open("rb") as file:
        return file.read(_USER_BLOCK)


def _contents(file: h5py.File) -> dict[str, Any]:
    """Read every dataset, and every attribute below the root, by name."""
    size = Path(file.filename).stat().st_size
    flat: dict[str, Any] = {}

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if isinstance(item, h5py.Dataset):
            # A damaged shape may ask for more memory than there is.
            if item.size and item.nbytes > size:
                raise ValueError(name)
            flat[name] = item[()]
        else:
            flat.update({f"{name}/{key}": _plain(value) for key, value in item.attrs.items()})

    file.visititems(visit)
    return flat


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
