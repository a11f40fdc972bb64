"""The one place of this computer for what belongs to its hardware: locks, lockouts, and what was played.

Every program of every user must find the same files, so the place depends on no environment variable and
on no user. Others can write there too: no file is opened through a symbolic link.
"""

from __future__ import annotations

import hashlib
import os
import stat
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from ...base.errors import InstrumentError

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
