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

from ...base.errors import InstrumentError
from ...base.file_lock import taken
from ...base.marks import InUse, held_open, keeping, still
from . import machine
from .audit import who

_TRIES = 1000
"""Attempts to lock a file that its last holder removes meanwhile."""
_reserved: set[str] = set()
_held: set[str] = set()


def _forked() -> None:
    """A forked child has no hardware: its parent keeps all locks."""
    _reserved.clear()
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


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
def _locked(piece: str, what: str) -> Iterator[None]:
    path = machine.folder() / machine.file_for(piece, "lock")
    descriptor = _lock(path, piece, what)
    with keeping(descriptor, path), _named(path, piece, what):
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
    held_open[token] = name.fileno()
    try:
        yield
    finally:
        if held_open.pop(token, None) is None:  # in a forked child it is closed already
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
        if still(path, descriptor):
            return descriptor
        os.close(descriptor)
    raise InUse(f"{what} is in use ({piece}) by other programs, one after the other: try again.")
