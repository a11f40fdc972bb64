"""Store dataclasses as HDF5 files: packed, written whole, never over another file, verified when read.

A dataclass becomes a group: arrays are datasets, everything else is an attribute (tuples as JSON).
Complex numbers are two data sets, `NAME_real` and `NAME_imaginary`: readers have no type for them in common.
A nested dataclass is a subgroup; a tuple of dataclasses is one subgroup for each member. The root's
attributes state the kind of file (`format`, `format_version`), the version of haploop that wrote it
(`software`), and the content's hash (`content_hash`), which is recomputed on every load, after the
checksum of the whole file (`checksum`).
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from functools import lru_cache, partial
from importlib import metadata
from itertools import product
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import h5py
import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from .arrays import scalar_of
from .checksum import NAME as CHECKSUM
from .checksum import add_checksum, bounded, created, opened, stated, unreadable
from .errors import DataError
from .files import new_file
from .parts import Parted

Flat = dict[str, NDArray[Any] | float | int | bool | str]
"""A dataclass flattened to plain values, with slashes in the names of nested fields."""
Value = TypeVar("Value")

VERSION = 3
_REAL, _IMAGINARY = "_real", "_imaginary"
_LABELS = ("format", "format_version", "software", "content_hash")
_UNPACKED = 64
"""Size of an array over its size in the file, at most: 3 for measured ones, 1000 for constant ones."""
_ELSE = "it was not written by this version of haploop"


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


def digest_of(value: Any) -> str:
    """Content hash that a file of `value` has, or would have."""
    return digest(flatten(value))


def restore(kind: type[Value], flat: Flat, path: str | Path, prefix: str = "") -> Value:
    """Rebuild the dataclass from the mapping of `flatten`.

    Raises DataError when a field is missing or of another type, or the dataclass refuses its content: when it
    is made, or by a method `refuse_nonsense`, for content that a script can make and no measurement has.
    """
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        key = prefix + name
        nested = next((kind for kind in (hint, *get_args(hint)) if dataclasses.is_dataclass(kind)), None)
        if nested is not None and get_origin(hint) is not tuple and key not in flat:
            values[name] = restore(nested, flat, path, key + "/")  # type: ignore[arg-type]
        elif f"{key}/count" in flat:
            member = get_args(hint)[0]
            count = flat[f"{key}/count"]
            if not isinstance(count, int):
                raise DataError(f"{path} holds no number of {key!r}: {_ELSE}.")
            values[name] = tuple(restore(member, flat, path, f"{key}/{n:04d}/") for n in range(count))
        elif key not in flat:
            raise DataError(f"{path} holds no {key!r}: {_ELSE}.")
        else:
            with unreadable(path, f"{path} holds a {key!r} of another type: {_ELSE}."):
                values[name] = _field(hint, flat[key])
    try:
        made = kind(**values)
        if refuse_nonsense := getattr(made, "refuse_nonsense", None):
            refuse_nonsense()
        return made
    except DataError as error:
        raise DataError(f"{path} cannot be used: {error}") from None


def write(path: str | Path, kind: str, flat: Flat, *, packed: bool = False) -> None:
    """Write a new file of a kind. Raises DataError when `path` exists or cannot be written.

    `packed` compresses the arrays without loss (bytes sorted by their place in a value, then deflated): what
    a converter measured takes a third.
    """
    with new_file(path) as part:
        with created(part) as file:
            file.attrs.update(
                format=f"haploop {kind}",
                format_version=VERSION,
                software=f"haploop {metadata.version('haploop')}",
                content_hash=digest(flat),
            )
            for name, value in flat.items():
                if isinstance(value, np.ndarray):
                    for own, array in _parts(name, value):
                        if packed and array.size:
                            write_packed(file, own, array)
                        else:
                            file.create_dataset(own, data=array)
                else:
                    group, _, own = name.rpartition("/")
                    file.require_group(group or "/").attrs[own] = value
        add_checksum(part, kind)


def _parts(name: str, value: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    if value.dtype.kind != "c":
        return [(name, value)]
    return [
        (name + _REAL, np.ascontiguousarray(value.real)),
        (name + _IMAGINARY, np.ascontiguousarray(value.imag)),
    ]


def _whole(flat: dict[str, Any]) -> None:
    """Put the two parts of complex arrays together. Raises ValueError for parts that do not fit."""
    for name in [key for key in flat if key.endswith(_IMAGINARY)]:
        imaginary = flat.pop(name)
        own = name.removesuffix(_IMAGINARY)
        real = flat.pop(own + _REAL)
        if real.shape != imaginary.shape or real.dtype != imaginary.dtype or real.dtype.kind != "f":
            raise ValueError(own)
        flat[own] = np.empty(real.shape, np.result_type(real.dtype, np.complex64))
        flat[own].real, flat[own].imag = real, imaginary


def read(path: str | Path, kind: str) -> Flat:
    """Read a file of `write`. Raises DataError when it is missing, of another kind, or damaged."""
    if (found := kind_of(path)) != kind:
        raise DataError(f"{path} is not a haploop {kind}: it holds a {found}.")
    with opened(path) as file:
        flat = _contents(file)
        labels = {key: flat.pop(key, None) for key in _LABELS}
        if labels["format_version"] != VERSION:
            raise DataError(
                f"{path} has format {str(labels['format_version'])[:20]} and this version reads {VERSION}: "
                f"it was written by {str(labels['software'])[:60]}."
            )
        if labels["content_hash"] != digest(flat):
            raise DataError(f"{path} was changed after it was written: its content does not match its hash.")
    return flat


def kind_of(path: str | Path) -> str:
    """Kind stated in a file: "recording", or a kind given to `write`. Raises DataError."""
    return stated(path).kind


def _contents(file: h5py.File) -> dict[str, Any]:
    """Read every attribute and every dataset by name. Raises ValueError for more than the file can hold."""
    left = file.id.get_filesize()
    flat: dict[str, Any] = {}

    def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
        nonlocal left
        if name == CHECKSUM:
            return
        if isinstance(item, h5py.Dataset):
            flat[name], stored = _values(item, left)
            left -= stored
            return
        for key in item.attrs:
            if item.attrs.get_id(key).get_storage_size() > left:
                raise ValueError(f"{key} is larger than its file")
            flat[f"{name}/{key}".lstrip("/")] = _plain(item.attrs[key])

    visit("", file)
    file.visititems(visit)
    _whole(flat)
    return flat


def _values(dataset: h5py.Dataset, left: int) -> tuple[NDArray[Any], int]:
    """A dataset's values, and the bytes that they take in the file, `left` at most.

    Raises ValueError for more than the file can hold.
    """
    plan = dataset.id.get_create_plist()
    if plan.get_layout() != h5py.h5d.CHUNKED or plan.get_external_count():
        values = bounded(dataset, left)[()]
        return values, values.nbytes
    stored = dataset.id.get_storage_size()
    if dataset.size * dataset.dtype.itemsize > _UNPACKED * min(stored, left):
        raise ValueError(f"{dataset.name} is larger than its file")
    return dataset[()], stored


def _field(hint: Any, value: Any) -> Any:
    """The value of a field with this type hint. Raises ValueError and TypeError for any other content."""
    if get_origin(hint) is UnionType and isinstance(value, np.ndarray):  # an array, or None
        hint = next((one for one in get_args(hint) if scalar_of(one) is not None), hint)
    if get_origin(hint) is UnionType and type(value) is float and float in get_args(hint):  # or None
        return value
    if (scalar := scalar_of(hint)) is not None:
        if not isinstance(value, np.ndarray) or not np.can_cast(value.dtype, scalar, "same_kind"):
            raise TypeError(hint)
    elif get_origin(hint) in (tuple, Mapping, UnionType):
        if not isinstance(value, str):
            raise TypeError(hint)
        found = json.loads(value)
        # Neither holds values that could be of another type; an adapter of a dataclass is slow to make.
        if found is not None and found != []:
            _adapter(hint).validate_json(value, strict=True)
        return _tuples(found)
    elif hint is float:
        if type(value) not in (float, int):
            raise TypeError(hint)
    elif type(value) is not (hint if isinstance(hint, type) else str):
        raise TypeError(hint)
    return value


@lru_cache(maxsize=256)
def _adapter(hint: Any) -> TypeAdapter[Any]:
    return TypeAdapter(hint)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


# Arrays packed into HDF5 files, deflated eight times as fast as by the library itself.

_Inflater: Any
_InflateError: Any
try:
    from isal import isal_zlib

    _deflated, _Inflater = partial(isal_zlib.compress, level=2), isal_zlib.decompressobj
    _InflateError = isal_zlib.error
except ImportError:  # no wheel for this processor
    import zlib

    _deflated, _Inflater, _InflateError = partial(zlib.compress, level=4), zlib.decompressobj, zlib.error


def write_packed(
    group: h5py.Group,
    name: str,
    values: NDArray[Any] | Parted,
    chunks: tuple[int, ...] | bool = True,
    *,
    fletcher32: bool = False,
    attributes: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Write an array that is not empty, without loss, after its attributes: the chunks come last.

    In each chunk the bytes are sorted by their place in a value and deflated, with a checksum if asked for:
    HDF5's filters shuffle, deflate and fletcher32, with which any reader of HDF5 undoes it.
    """
    dataset = group.create_dataset(
        name,
        values.shape,
        values.dtype,
        chunks=chunks,
        shuffle=True,
        compression="gzip",
        fletcher32=fletcher32,
    )
    dataset.attrs.update(attributes)
    steps = dataset.chunks
    for begin in product(*(range(0, size, step) for size, step in zip(values.shape, steps, strict=True))):
        part = values[tuple(slice(at, at + step) for at, step in zip(begin, steps, strict=True))]
        chunk = np.zeros(steps, values.dtype)  # also where it reaches beyond the array
        chunk[tuple(map(slice, part.shape))] = part
        packed = _deflated(chunk.view(np.uint8).reshape(-1, values.dtype.itemsize).T.tobytes())
        dataset.id.write_direct_chunk(begin, packed + (_fletcher32(packed) if fletcher32 else b""))


def _fletcher32(packed: bytes) -> bytes:
    """Fletcher's checksum as HDF5 stores it: of big-endian words, the last one padded with a zero."""
    words = np.frombuffer(packed + b"\0" * (len(packed) % 2), ">u2").astype(np.int64)
    sums = int(words.sum()), int(words @ np.arange(len(words), 0, -1))
    # Sums are folded, not divided: a multiple of 65,535 stays 65,535.
    low, high = (total and (total - 1) % 0xFFFF + 1 for total in sums)
    return (high << 16 | low).to_bytes(4, "little")


_PACKED = [h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32]


def read_packed(dataset: h5py.Dataset, first: int, end: int) -> NDArray[Any]:
    """Samples `first` to `end` - 1 of a two-dimensional array of `write_packed`, whose chunks hold all rows.

    In half the time that HDF5's filters take. The chunks' own checksums are not compared: the file's was.
    """
    plan = dataset.id.get_create_plist()
    if [plan.get_filter(at)[0] for at in range(plan.get_nfilters())] != _PACKED:
        return np.asarray(dataset[:, first:end])
    rows, width = dataset.chunks
    found = np.empty((rows, end - first), dataset.dtype)
    size = rows * width * dataset.dtype.itemsize
    for at in range(first // width * width, end, width):
        skipped, packed = dataset.id.read_direct_chunk((0, at))
        try:
            plain = _Inflater().decompress(packed[:-4], size + 1)
        except _InflateError as error:
            raise ValueError(dataset.name) from error
        if skipped or len(plain) != size:
            raise ValueError(dataset.name)
        planes = np.frombuffer(plain, np.uint8).reshape(dataset.dtype.itemsize, rows, width)
        low, high = max(first, at), min(end, at + width)
        into = found[:, low - first : high - first].view(np.uint8).reshape(rows, high - low, -1)
        for byte, plane in enumerate(planes):
            into[..., byte] = plane[:, low - at : high - at]
    return found
