"""The one place of this computer for what belongs to its hardware; and the lock of a piece of hardware.

Every program of every user must find the same files, so the place depends on no environment variable and
on no user. Others can write there too: no file is opened through a symbolic link.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import stat
import subprocess
import sys
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ...base.errors import InstrumentError
from ...base.marks import InUse, held_open, keeping, still, taken
from .audit import who

_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_FLAGS = _NO_LINK | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOINHERIT", 0)
# A sticky file is not cleared away by systemd-tmpfiles, which would end a lockout after 30 days.
_MODE = 0o1666
_LONGEST = 1 << 20
"""Longest file that is read (bytes)."""


def folder() -> Path:
    """The place, made when it is missing. Raises InstrumentError when it cannot be used.

    On Linux `/var/lib/haploop` if an administrator has made it (with mode 1777), else `/var/tmp/haploop`; on
    macOS `/Users/Shared/haploop`, on Windows `haploop` in the folder for data of all users.
    """
    path = _place()
    try:
        with suppress(FileExistsError):
            path.mkdir()
            _for_everybody(path)
        found = path.lstat()
        if not stat.S_ISDIR(found.st_mode) or _is_link(path):
            raise NotADirectoryError(20, "it is not a folder of its own")
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(13, "permission denied")
    except OSError as error:
        raise InstrumentError(
            f"haploop keeps the locks and lockouts of this computer's hardware in {path}, which cannot be "
            f"used ({error.strerror}): make it a folder that every user may write."
        ) from None
    return path


def file_for(piece: str, ending: str) -> str:
    """Name of the file of a piece of hardware."""
    return f"{hashlib.sha256(piece.encode()).hexdigest()[:16]}.{ending}"


def open_file(path: Path) -> int:
    """Open a file for reading and writing, and make it when it is missing; never through a link.

    Returns the descriptor. Raises OSError.
    """
    # In a shared folder, Linux refuses O_CREAT for another user's file, even if it exists.
    try:
        descriptor = _opened(path, os.O_RDWR)
    except FileNotFoundError:
        descriptor = _opened(path, os.O_RDWR | os.O_CREAT)
        with suppress(OSError):  # another user's
            os.chmod(path, _MODE)  # noqa: PTH101  the umask may have taken the others' rights
    return descriptor


def read(path: Path) -> bytes:
    """Content of a file. Raises OSError, FileNotFoundError among them."""
    descriptor = _opened(path, os.O_RDONLY)
    with os.fdopen(descriptor, "rb") as file:
        return file.read(_LONGEST)


def write(path: Path, content: bytes) -> None:
    """Write a file in place, synced, because nobody may replace another user's. Raises OSError."""
    with os.fdopen(open_file(path), "rb+") as file:
        file.truncate()
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _opened(path: Path, flags: int) -> int:
    if _is_link(path):  # Windows has no O_NOFOLLOW
        raise OSError(40, "it is a symbolic link")
    descriptor = os.open(path, flags | _FLAGS, 0o666)
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        os.close(descriptor)
        raise OSError(22, "it is not a file of its own")
    return descriptor


def _is_link(path: Path) -> bool:
    is_junction = getattr(os.path, "isjunction", os.path.islink)  # Python 3.12 and newer
    return path.is_symlink() or bool(is_junction(path))


if sys.platform == "win32":
    import winreg

    _COMMON = r"SOFTWARE\Microsoft\Windows\CurrentVersion\Explorer\Shell Folders"

    def _place() -> Path:
        # Not %PROGRAMDATA%: a program's environment may say anything.
        with winreg.OpenKey(winreg.HKEY_LOCAL_MACHINE, _COMMON) as key:
            return Path(winreg.QueryValueEx(key, "Common AppData")[0]) / "haploop"

    def _for_everybody(path: Path) -> None:
        # S-1-5-32-545 are all users of this computer; without it they may only read each other's files.
        command = ["icacls", str(path), "/grant", "*S-1-5-32-545:(OI)(CI)M", "/Q"]
        subprocess.run(command, check=False, capture_output=True, timeout=10)

else:

    def _place() -> Path:
        if sys.platform == "darwin":
            return Path("/Users/Shared/haploop")
        made = Path("/var/lib/haploop")
        return made if made.is_dir() else Path("/var/tmp/haploop")

    def _for_everybody(path: Path) -> None:
        path.chmod(0o1777)


# Lock a piece of hardware for one program at a time; a lock ends with its holder.

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
    path = folder() / file_for(piece, "lock")
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
            descriptor = open_file(path)
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
