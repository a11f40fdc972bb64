"""Publish files atomically: under its own name a file is complete, and no other file is replaced.

A file is written beside its destination under a hidden name (`.<name>.<random>.part`), synced, and then
given its name in one step that fails if the name is taken. A program that is killed leaves either
nothing under the name or the complete file; its hidden part is removed by the next program that writes into
the folder.

A command that measures holds its names and its room before it begins (`reserved`), and its files get their
names together or not at all: a file without the one that belongs to it would refuse the same command.
"""

from __future__ import annotations

import errno
import io
import os
import re
import secrets
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import BinaryIO, cast

from .errors import ConfigurationError, DataError, HaploopError
from .publishing import publish, replaced, sync_folder

_A_WHILE = 60.0
"""Age from which a part that nobody has open is a killed program's, on Windows (s)."""

_private: ContextVar[bool] = ContextVar("private", default=False)


@contextmanager
def private_files() -> Iterator[None]:
    """Files and folders that are made within are of people, and can be read by their owner alone.

    Files are 0600 and folders 0700; on Windows they have the rights of the folder that they are made in.
    """
    token = _private.set(True)
    try:
        yield
    finally:
        _private.reset(token)


def paths_of(given: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Several paths, or a single one: a string is a path and not its letters."""
    return [Path(given)] if isinstance(given, str | os.PathLike) else [Path(one) for one in given]


def beside(folder: Path, place: str, named_by: str, wrong: type[HaploopError] = ConfigurationError) -> Path:
    """The file at a place that a file in `folder`, perhaps another person's, names: in this folder or below.

    Raises `wrong` for a place that any system takes for absolute or a way up, and for a link that leads out.
    """
    parts = PureWindowsPath(place)  # knows both separators, drives and shares
    path = folder / place
    try:
        inside = bool(parts.name) and not parts.anchor and ".." not in parts.parts
        inside = inside and path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a loop of links, a zero byte
        inside = False
    if not inside:
        raise wrong(
            f"{named_by} names {place[:200]!r}, which leads out of its folder: copy that file into "
            f"{folder.absolute()}, and name it there."
        )
    return path


def check_destination(path: Path) -> None:
    """Create the folder. Raises ConfigurationError for a destination that exists or cannot be written.

    A command calls this before it measures, so that every result can be saved. An existing folder keeps its
    rights.
    """
    if not path.name:  # "" and "." are this folder
        raise ConfigurationError(existing(path))
    try:
        make_folder(path.parent)
        with _part_of(path):  # under the longest name that it will have
            pass
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            name = max(path.parts, key=len)
            raise ConfigurationError(
                f"{name[:20]}... has {len(name)} characters, which is too long a name for a file or folder: "
                "choose a shorter one."
            ) from None
        raise ConfigurationError(
            f"The folder {path.parent} cannot be written ({os_error_text(error)}): choose another folder."
        ) from None
    if os.path.lexists(path):
        raise ConfigurationError(existing(path))


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it; one that exists keeps its rights. Raises OSError."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700 if _private.get() else 0o777, exist_ok=True)


def appended(path: Path) -> BinaryIO:
    """Open a file to append to it, without a buffer: a full disk is told at once. Raises OSError."""
    mode = 0o600 if _private.get() else 0o666
    opened = open(path, "ab", buffering=0, opener=lambda name, flags: os.open(name, flags, mode))  # noqa: SIM115
    return cast(BinaryIO, opened)


WRITE_ERRORS = (OSError, RuntimeError, ValueError)
"""Errors of writing a file: a disk's refusal, and what the HDF5 library makes of it."""


class Room:
    """Bytes of a disk that are held for what is measured next; `free` gives them back as it is written."""

    def __init__(self, file: io.FileIO, size: int) -> None:
        self._file, self._size = file, size

    def free(self, size: int | None = None) -> None:
        """Give back `size` bytes, all by default. Raises OSError."""
        self._size = 0 if size is None else max(0, self._size - size)
        self._file.truncate(self._size)


@contextmanager
def room(folder: Path, size: int) -> Iterator[Room]:
    """Hold `size` bytes of a folder's disk. Raises ConfigurationError when it does not have them.

    They are a hidden file, which is removed at the end; that of a killed program is removed by the next.
    """
    with ExitStack() as stack:
        try:
            part, file = stack.enter_context(_part_of(folder / "room"))
            _clear_abandoned(part)
            allocate(file.fileno(), 0, size)
        except OSError as error:
            raise ConfigurationError(
                f"{folder} cannot take the {max(1, round(size / 1e6))} MB that may be measured "
                f"({os_error_text(error)}): free the space, or choose another folder."
            ) from None
        yield Room(file, size)


@dataclass
class _Batch:
    """Files that get their names together: the open part of each that was written."""

    names: frozenset[Path]
    room: Room
    written: dict[Path, tuple[Path, io.FileIO]] = field(default_factory=dict)
    stack: ExitStack = field(default_factory=ExitStack)


_batch: ContextVar[_Batch | None] = ContextVar("batch", default=None)


@contextmanager
def reserved(*paths: Path, size: int) -> Iterator[None]:
    """Hold the room of new files of one folder, `size` bytes in all, while they are measured.

    What `new_file` writes to these paths within gets its name at the end of the block: all files, or none
    after an exception. Raises ConfigurationError before the block when a file exists or the disk cannot take
    them, and DataError at its end.
    """
    for path in paths:
        check_destination(path)
    with room(paths[0].parent, size) as held, ExitStack() as stack:
        batch = _Batch(frozenset(path.absolute() for path in paths), held, stack=stack)
        token = _batch.set(batch)
        try:
            yield
        finally:
            _batch.reset(token)
        _publish_together(batch)


def _publish_together(batch: _Batch) -> None:
    done: list[tuple[Path, os.stat_result]] = []
    try:
        for path, (part, file) in batch.written.items():
            with _told(path):
                same = part.stat()
                _publish_part(part, file, path)
                done.append((path, same))
    except BaseException:
        for path, same in done:
            with suppress(OSError):
                if os.path.samestat(path.lstat(), same):
                    path.unlink()
        raise


@contextmanager
def new_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; the file written there becomes `path` when the block succeeds,
    or, of a path that is `reserved`, with the others.

    As `whole_file`, but with one-sentence errors: DataError when `path` exists or cannot be written.
    """
    path = Path(path)
    batch = _batch.get()
    if batch is None or path.absolute() not in batch.names:
        if os.path.lexists(path):
            raise DataError(existing(path))
        with _told(path), whole_file(path) as part:
            yield part
        return
    if os.path.lexists(path) or path.absolute() in batch.written:
        raise DataError(existing(path))
    with _told(path):
        batch.room.free()
        part, file = batch.stack.enter_context(_part_of(path))
        yield part
        os.fsync(file.fileno())
    batch.written[path.absolute()] = part, file


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """One sentence, a DataError, for a file that exists or cannot be written."""
    try:
        yield
    except FileExistsError:
        raise DataError(existing(path)) from None
    except (OSError, RuntimeError) as error:  # h5py raises a RuntimeError when a disk fills up on closing
        raise DataError(f"{path} cannot be written: {os_error_text(error)}.") from None


@contextmanager
def whole_file(path: Path, *, replace: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`, of an empty file; what is written there becomes `path`.

    It is synced and renamed: without `replace`, as `publish`. After an exception no file remains. Raises
    FileExistsError and OSError.
    """
    with _part_of(path) as (part, file):
        _clear_abandoned(part)
        yield part
        os.fsync(file.fileno())
        _publish_part(part, file, path, replace=replace)


@contextmanager
def _part_of(path: Path) -> Iterator[tuple[Path, io.FileIO]]:
    """The hidden part of a file, and the same held open; closed and removed at the end."""
    part, descriptor = _new_part(path, 0o600 if _private.get() else 0o666)
    file = io.FileIO(descriptor, "r+")
    try:
        yield part, file
    finally:
        with suppress(OSError):  # it was synced before
            file.close()
        with suppress(OSError):  # beside a published file, a part that cannot be removed is no failure
            part.unlink(missing_ok=True)


def _publish_part(part: Path, file: io.FileIO, path: Path, *, replace: bool = False) -> None:
    if os.name == "nt":  # renames no file that is open
        file.close()
    if replace:
        replaced(part, path)
        sync_folder(path.parent)
    else:
        publish(part, path)


def allocate(file: int, place: int, length: int) -> None:
    """Allocate `length` zero bytes at `place` of an open file, so that the disk cannot fill up later."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, place, length)
        return
    os.lseek(file, place, os.SEEK_SET)
    while length > 0:
        length -= os.write(file, bytes(min(length, 1 << 20)))


def stamp(path: Path) -> tuple[int, ...]:
    """What differs between two states of a file; empty where there is none."""
    try:
        status = path.stat()
    except OSError:
        return ()
    return status.st_ino, status.st_size, status.st_mtime_ns


def existing(path: Path) -> str:
    """Error message for a destination that exists."""
    return f"{path} already exists and is not overwritten: move it away, or write to another place."


def os_error_text(error: BaseException) -> str:
    """The operating system's message for a file that could not be read or written.

    The HDF5 library's own text is full of addresses and offsets, and some of its errors have no `errno`:
    that of closing a file on a full disk has the number only in its text.
    """
    said = re.search(r"errno = (\d+)", str(error))
    number = getattr(error, "errno", None) or (int(said[1]) if said else None)
    return os.strerror(number) if number else "the disk may be full"


_PART = re.compile(r"\..+\.[0-9a-f]{16}\.part")


def _new_part(path: Path, mode: int) -> tuple[Path, int]:
    """Create the hidden part of a file, and hold it open, so that no other program takes it for abandoned."""
    while True:
        part = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        descriptor = os.open(part, flags, mode)
        _locked(descriptor, wait=True)
        if part.exists():
            return part, descriptor
        # Another program cleared it between its creation and its lock.
        os.close(descriptor)


def _clear_abandoned(own: Path) -> None:
    """Remove the hidden parts that killed programs have left in the folder of a new one.

    Those of running programs are locked. On Windows they are open, but for the moment before they get their
    name: there, parts stay that are not much older.
    """
    with suppress(OSError):
        recent = own.stat().st_mtime - _A_WHILE
        for entry in os.scandir(own.parent):
            if not _PART.fullmatch(entry.name) or not entry.is_file(follow_symlinks=False):
                continue
            with suppress(OSError):
                if os.name == "nt":
                    if entry.stat().st_mtime < recent:
                        Path(entry).unlink()
                    continue
                descriptor = os.open(entry, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
                try:
                    if _locked(descriptor):
                        Path(entry).unlink()
                finally:
                    os.close(descriptor)


if sys.platform == "win32":

    def _locked(_descriptor: int, wait: bool = False) -> bool:
        return wait

else:
    import fcntl

    def _locked(descriptor: int, wait: bool = False) -> bool:
        """Lock a file until it is closed. False when another program has it, or the disk has no locks."""
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:
            return False
        return True
