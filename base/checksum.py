"""The checksum of an HDF5 file in a data set of its own, compared before the HDF5 library reads anything.

That library can crash, or ask for any amount of memory, on a damaged file (a crash within 1000 random
changes of a byte in metadata, measured). So the file's first data set, `/checksum`, holds 512 bytes of text
that are found without it: they lie within the first 8192 bytes and begin with a mark. They state the kind of
file, its number of bytes, and their SHA-256 (docs/reference/format.md, "The checksum"). They do not stand
before the file, in a user block, which some readers do not take into account: these give other bytes for the
numbers, without a word. They do not stand at its end: a truncated file must still say what it was.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np

from .errors import DataError
from .signals import uninterrupted

NAME = "checksum"
"""The data set."""
BLOCK = 512
"""Its bytes."""
_MARK = b'{"haploop": '
_HEAD = 8192
"""Bytes at the beginning of a file in which it lies."""

UNREADABLE = (
    OSError, LookupError, RuntimeError, ValueError, TypeError, AttributeError, ArithmeticError, MemoryError,
    AssertionError,
)  # fmt: skip
"""Exceptions that h5py, and decoding what it read, raise for content that haploop did not write."""

_STEP = 1 << 20
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_HINT = {"recording": ", or salvage the intact part with `haploop recover`"}


@dataclass(frozen=True)
class Stated:
    """What the checksum of a file states."""

    kind: str
    """Kind of file, such as "recording" or "drive"."""
    count: int
    """Number of bytes of the file."""
    without: tuple[tuple[int, int], ...]
    """Ranges (offset in the file, number) that change later, and have checksums of their own."""
    sha256: str

    def block(self) -> bytes:
        """The 512 bytes."""
        text = json.dumps(
            {"haploop": self.kind, "bytes": self.count, "without": self.without, "sha256": self.sha256}
        )
        return text.encode().ljust(BLOCK)


def add_checksum(path: Path, kind: str, without: Sequence[tuple[int, int]] = ()) -> None:
    """Write the checksum of a file of `created`. Raises OSError."""
    with path.open("rb+") as file:
        place = _place(file)
        if place is None:
            raise OSError(f"{path} has no data set {NAME!r} within its first {_HEAD} bytes")
        count = os.fstat(file.fileno()).st_size
        ranges = tuple(sorted((int(first), int(number)) for first, number in without))
        block = Stated(kind, count, ranges, _sha256(file, kind, count, ranges, place)).block()
        file.seek(place)
        file.write(block)


def _place(file: BinaryIO) -> int | None:
    """Offset of the checksum; None without one."""
    file.seek(0)
    found = file.read(_HEAD).find(_MARK)
    return None if found < 0 else found


def stated(path: str | Path) -> Stated:
    """What a file states of itself, which is not compared. Raises DataError for no file of haploop's."""
    with _bytes_of(path) as file:
        return _stated(file, path)[0]


@contextmanager
def opened(path: str | Path) -> Iterator[h5py.File]:
    """Open a file for reading, after its checksum was compared.

    Raises DataError for a file that is missing, not haploop's or damaged, also for errors on reading its
    content within the context.
    """
    with _bytes_of(path) as file:
        said, place = _stated(file, path)
        size = os.fstat(file.fileno()).st_size
        hint = f"Copy it again from its source{_HINT.get(said.kind, '')}."
        if size < said.count:
            raise DataError(f"{path} is truncated: it has {size} of {said.count} bytes. {hint}")
        if size > said.count or said.sha256 != _sha256(file, said.kind, said.count, said.without, place):
            raise DataError(
                f"{path} was damaged or changed after it was written: its content does not match its "
                f"checksum. {hint}"
            )
    with (
        unreadable(path, f"{path} was not written by haploop: it cannot be read."),
        # Not locked: a file is complete when it has its name, and network disks refuse locks.
        h5py.File(path, "r", locking=False) as hdf5,
    ):
        yield hdf5


@contextmanager
def created(path: Path) -> Iterator[h5py.File]:
    """Fill an existing, empty file with HDF5; the caller adds the checksum, whose place is kept.

    Raises OSError when the disk refuses. The HDF5 library does not see that: after a failed write it cannot
    close a file, keeps it open, and tells so on standard error when the program ends.

    Ctrl-C waits until the end. The library calls Python to read and write: where a signal's exception comes
    there, it loses count of its objects, and the program crashes when Python frees them (at 10 of 44 calls,
    measured).
    """
    with uninterrupted(), path.open("rb+", buffering=0) as raw:
        disk = _Disk(raw)
        try:
            with h5py.File(disk, "w") as file:
                file.create_dataset(NAME, data=np.bytes_(_MARK.ljust(BLOCK)))
                yield file
        except UNREADABLE:  # what was not written cannot be read back
            if disk.failure is None:
                raise
        if disk.failure is not None:
            raise disk.failure


class _Disk(io.RawIOBase):
    """A file whose failing writes seem to succeed; the first error is kept in `failure`."""

    def __init__(self, raw: io.FileIO) -> None:
        self._raw = raw
        self.failure: OSError | None = None

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return self._raw.seek(offset, whence)

    def tell(self) -> int:
        return self._raw.tell()

    def readinto(self, buffer: Any) -> int:
        # HDF5 reads back what it wrote: what was not written is zeros.
        view = memoryview(buffer).cast("B")
        count = self._kept(self._raw.readinto, view) or 0
        view[count:] = bytes(len(view) - count)
        return len(view)

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        while left and (count := self._kept(self._raw.write, left)):
            left = left[count:]
        return memoryview(data).nbytes

    def truncate(self, size: int | None = None) -> int:
        self._kept(self._raw.truncate, size)
        return size or 0

    def _kept(self, call: Callable[..., int | None], *arguments: Any) -> int | None:
        try:
            return call(*arguments) if self.failure is None else None
        except OSError as error:
            self.failure = error
            return None


@contextmanager
def unreadable(path: str | Path, sentence: str) -> Iterator[None]:
    """Raise DataError(sentence) for the exceptions of reading content that haploop did not write."""
    try:
        yield
    except UNREADABLE as error:
        if isinstance(error, PermissionError):
            raise DataError(f"You have no permission to read {path}: ask its owner.") from None
        raise DataError(sentence) from None


def bounded(dataset: h5py.Dataset, size: int) -> h5py.Dataset:
    """Return a dataset whose content is in its file. Raises ValueError when `size` bytes cannot hold it.

    A declared shape may ask for more memory than there is, and a dataset may refer to other files.
    """
    plan = dataset.id.get_create_plist()
    if plan.get_external_count() or plan.get_layout() not in (h5py.h5d.CONTIGUOUS, h5py.h5d.COMPACT):
        raise ValueError(f"{dataset.name} is not contiguous")
    if dataset.size and dataset.size * dataset.dtype.itemsize > size:
        raise ValueError(f"{dataset.name} is larger than its file")
    return dataset


@contextmanager
def _bytes_of(path: str | Path) -> Iterator[BinaryIO]:
    if not Path(path).is_file():
        raise DataError(f"There is no file {path}: check the name.")
    with unreadable(path, f"{path} cannot be read: check the disk."), Path(path).open("rb") as file:
        yield file


def _stated(file: BinaryIO, path: str | Path) -> tuple[Stated, int]:
    """Parse the checksum; also its offset. Raises DataError for anything that haploop did not write."""
    file.seek(0)
    start = file.read(len(_SIGNATURE))
    if not start:
        raise DataError(f"{path} is truncated: it is empty. Copy it again from its source.")
    place = _place(file)
    try:
        if place is None:
            raise LookupError
        file.seek(place)
        block = file.read(BLOCK)
        said = json.loads(block)
        without = tuple((int(first), int(number)) for first, number in said["without"])
        result = Stated(str(said["haploop"]), int(said["bytes"]), without, str(said["sha256"]))
    except (ValueError, LookupError, TypeError, RecursionError, OverflowError):
        foreign = start == _SIGNATURE
        raise DataError(
            f"{path} is an HDF5 file, but was not written by this version of haploop, or is damaged."
            if foreign
            else _no_file(file, path)
        ) from None
    if result.block() != block:
        raise DataError(f"{path} is damaged in its checksum. Copy it again from its source.")
    return result, place


def _no_file(file: BinaryIO, path: str | Path) -> str:
    """A sentence about a file that is no HDF5 file."""
    file.seek(0)
    start = file.read(BLOCK)
    if b"\0" not in start and not start.startswith(_SIGNATURE[:1]):
        return (
            f"{path} is text, and no file of haploop: name one that it has written, or `haploop import` it."
        )
    return f"{path} is damaged, or not a file of haploop. Copy it again from its source."


def _sha256(file: BinaryIO, kind: str, count: int, without: Sequence[tuple[int, int]], place: int) -> str:
    """SHA-256 (hex) of the checksum's other fields, and of all bytes outside of it and of `without`."""
    sha = hashlib.sha256(json.dumps([kind, count, without]).encode())
    at = 0
    for first, number in (*sorted([*without, (place, BLOCK)]), (count, 0)):
        file.seek(at)
        left = first - at
        while left > 0 and (data := file.read(min(left, _STEP))):
            sha.update(data)
            left -= len(data)
        at = max(at, first + number)
    return sha.hexdigest()
