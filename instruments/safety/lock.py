"""Lock a piece of hardware for one program at a time; a lock ends with its holder."""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import sys
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ..clock import RealClock
from ..errors import InstrumentError
from . import machine
from .audit import who
from .file_lock import taken

_TRIES = 1000
"""Attempts to lock a file that its last holder removes meanwhile."""
_LOOKS = 20
"""Attempts to take a mark, a millisecond apart: a program that tests it holds it for an instant."""

_reserved: set[str] = set()
_held: set[str] = set()
_kept: dict[object, int] = {}
"""Descriptors of the files whose locks this process holds."""


def _forked() -> None:
    """Leave every lock to the parent: a lock lasts as long as any process has the open file."""
    for descriptor in _kept.values():
        with suppress(OSError):
            os.close(descriptor)
    _kept.clear()
    _reserved.clear()
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


class InUse(InstrumentError):  # noqa: N818
    """Another program has the rig."""


@contextmanager
def reserve(hardware: Collection[str], what: str) -> Iterator[None]:
    """Keep every other program off these pieces of hardware while this context lasts.

    This program's rigs may open them, one after the other. `what` begins the error message.
    Raises InUse, which names the holder.
    """
    with ExitStack() as stack:
        for piece in sorted(set(hardware) - _reserved):
            stack.enter_context(_locked(piece, what))
            _reserved.add(piece)
            stack.callback(_reserved.discard, piece)
        yield


@contextmanager
def hold(hardware: Collection[str], what: str) -> Iterator[None]:
    """Lock these pieces of hardware against other programs and this program's other rigs.

    The operating system releases a lock when its holder ends, however it ends; a crash leaves only
    an unlocked file. Raises InUse, which names the holder.
    """
    with ExitStack() as stack:
        for piece in sorted(set(hardware)):
            if piece in _held:
                raise InUse(f"{what} is open in this program already ({piece}): close it first.")
        stack.enter_context(reserve(hardware, what))
        _held.update(hardware)
        stack.callback(_held.difference_update, hardware)
        yield


@contextmanager
def marked(path: Path) -> Iterator[None]:
    """Mark a file as being written by this program, by a lock on `.NAME.lock` beside it.

    The lock is not among the temporary files, so that every program that sees the file sees its mark,
    with any TMPDIR and on any computer. Raises InUse when another program has marked it.
    """
    mark = _mark_of(path)
    for _ in range(_LOOKS):
        descriptor = os.open(mark, os.O_RDWR | os.O_CREAT, 0o666)
        taken_here = _taken_soon(descriptor)
        # A mark that was removed since it was opened here, by its holder or a look at it, is seen by nobody.
        if taken_here and _still(mark, descriptor):
            break
        _close(mark, descriptor)
        if not taken_here:
            raise InUse(f"{path} is being written by another program: wait until it has ended, or end it.")
    else:
        raise InUse(f"{path} is being written by other programs, one after the other: try again.")
    with _keeping(descriptor, mark):
        yield


@contextmanager
def _keeping(descriptor: int, path: Path) -> Iterator[None]:
    """Keep a locked file, then remove it and close it; a forked child does neither."""
    token = object()
    _kept[token] = descriptor
    try:
        yield
    finally:
        if _kept.pop(token, None) is not None:
            with suppress(OSError):  # another user's: then it stays, unlocked
                path.unlink()
            _close(path, descriptor)


def _taken_soon(descriptor: int) -> bool:
    """Take a mark, which another program's look at it (`is_marked`) has for an instant."""
    clock = RealClock()
    for _ in range(_LOOKS):
        if taken(descriptor):
            return True
        clock.sleep(0.001)
    return False


def is_marked(path: Path) -> bool:
    """True when a running program has `path` marked. The mark that a killed one has left is removed."""
    mark = _mark_of(path)
    try:
        descriptor = os.open(mark, os.O_RDONLY)
    except OSError:
        return False
    is_left = taken(descriptor, shared=True)
    if is_left:
        with suppress(OSError):  # another user's
            mark.unlink()
        _close(mark, descriptor)
    else:
        os.close(descriptor)
    return not is_left


def _close(path: Path, descriptor: int) -> None:
    """Close a lock's file. Windows removes none that is open: there, the last program to close it does."""
    with suppress(OSError):  # what was done under the lock is done
        os.close(descriptor)
    if sys.platform == "win32":
        with suppress(OSError):  # another program has it open
            path.unlink()


def _still(mark: Path, descriptor: int) -> bool:
    """Whether an open mark has its name still. On Windows no file that is open loses it."""
    if sys.platform == "win32":
        return True
    try:
        return os.path.samestat(os.fstat(descriptor), mark.stat())
    except FileNotFoundError:
        return False


def _mark_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


@contextmanager
def _locked(piece: str, what: str) -> Iterator[None]:
    path = machine.folder() / machine.file_for(piece, "lock")
    descriptor = _lock(path, piece, what)
    with _keeping(descriptor, path), _named(path, piece, what):
        person = who()
        holder = f"process {person['pid']} ({person['command']}) of {person['user']} on {person['host']}"
        with suppress(OSError):  # on a full disk the holder has no name
            os.ftruncate(descriptor, 0)
            os.write(descriptor, holder.encode())
        yield


@contextmanager
def _named(path: Path, piece: str, what: str) -> Iterator[None]:
    """Take the name of a lock's path too, for programs that see another folder there (Linux).

    A service with a private `/var/tmp` has a mount namespace of its own, and the same network, in which such
    a name belongs to one socket, until its program ends. Raises InUse.
    """
    if sys.platform != "linux":
        yield
        return
    name, token = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM), object()
    try:
        # A path may be longer than a name.
        name.bind(f"\0haploop {hashlib.sha256(bytes(path)).hexdigest()}")
    except OSError as error:
        name.close()
        if error.errno == errno.EADDRINUSE:
            raise InUse(
                f"{what} is in use ({piece}) by a program that has a {path.parent} of its own, such as a "
                "service with a private /var/tmp: wait until it has ended, or end it."
            ) from None
        yield
        return
    _kept[token] = name.fileno()
    try:
        yield
    finally:
        if _kept.pop(token, None) is None:  # in a forked child it is closed already
            name.detach()
        name.close()


def _lock(path: Path, piece: str, what: str) -> int:
    """Lock a piece's file. Returns the descriptor, which holds the lock. Raises InUse, InstrumentError."""
    for _ in range(_TRIES):
        try:
            descriptor = machine.open_file(path)
        except OSError as error:
            raise InstrumentError(
                f"The lock of {piece} cannot be opened ({path}: {error.strerror}): remove what is there "
                "under this name."
            ) from None
        if not taken(descriptor):
            name = os.read(descriptor, 800).decode("utf-8", "replace").strip()
            os.close(descriptor)
            raise InUse(
                f"{what} is in use ({piece}) by {name or 'another program'}: wait until it has ended, or "
                "end it."
            )
        # A file that its last holder has removed since it was opened here locks nobody out.
        if _still(path, descriptor):
            return descriptor
        os.close(descriptor)
    raise InUse(f"{what} is in use ({piece}) by other programs, one after the other: try again.")
