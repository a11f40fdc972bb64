"""One program at a time on a rig's hardware: a lock per rig file, which dies with its holder."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from instruments.errors import InstrumentError

__all__ = ["hold"]

_BEYOND = 1 << 30
"""The byte that is locked: past the holder's name, which others must be able to read."""


@contextmanager
def hold(rig: Path, holder: str) -> Iterator[None]:
    """Keep everybody else off the rig that `rig` describes while this context lasts.

    The operating system lets go of the lock when its holder ends, however it ends: what a crash
    leaves behind is a file that nobody holds. Raises InstrumentError, which says who holds it.
    """
    path = _file_for(rig)
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise InstrumentError(
            f"The lock of the rig {rig} cannot be opened ({error}): does another user hold it?"
        ) from None
    try:
        if not _taken(descriptor):
            name = os.read(descriptor, 400).decode("utf-8", "replace").strip()
            raise InstrumentError(
                f"The rig {rig} is in use by {name or 'another program'}: wait until it has ended, or end it."
            )
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"process {os.getpid()} ({holder})".encode())
        yield
    finally:
        # Closing lets go of the lock. The file stays: removing it would let a third program lock
        # a new one while a second one waits for this one.
        os.close(descriptor)


def _file_for(rig: Path) -> Path:
    # In the folder for temporary files, because the rig file's own may be read-only. What is no
    # file is the name of a rig that haploop ships, wherever it is said.
    place = os.path.normcase(rig.resolve() if rig.exists() else rig)
    digest = hashlib.sha256(place.encode()).hexdigest()[:12]
    return Path(tempfile.gettempdir()) / f"haploop-{rig.stem}-{digest}.lock"


if sys.platform == "win32":
    import msvcrt

    def _taken(descriptor: int) -> bool:
        os.lseek(descriptor, _BEYOND, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
        return True

else:
    import fcntl

    def _taken(descriptor: int) -> bool:
        # Not lockf: that one is let go of when any file of the same name is closed.
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True
