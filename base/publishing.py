"""Names of files that are written: a file gets its name in one step, and is on the disk under it."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path

from .clock import RealClock

_PATIENCE = 5.0
"""Time to wait for those who read a file that is replaced (s)."""


def replaced(part: Path, path: Path) -> None:
    """Rename onto another file. Windows refuses while a program has it open, if only to read it: wait."""
    clock = RealClock()
    until = clock.now() + _PATIENCE
    while True:
        try:
            part.replace(path)
            return
        except PermissionError:
            if os.name != "nt" or clock.now() > until:
                raise
        clock.sleep(0.01)


def publish(source: Path, destination: Path) -> None:
    """Rename within a folder or disk without replacing another file, and sync the new name.

    Of several programs that use this, or create the file exclusively, exactly one wins; the others get
    FileExistsError, and keep `source`. An existing destination stays as it is. The name appears in one
    step, complete, with one exception: outside Windows, on a disk without hard links (a USB stick), an
    empty file claims the name for a moment. A crash in that moment leaves the empty file and all of
    `source`.

    Raises OSError. When only the sync of the folder fails, the file has its new name all the same.
    """
    if os.name == "nt":
        source.rename(destination)  # refuses an existing destination, on every file system
    else:
        try:
            os.link(source, destination)
        except FileExistsError:
            # A network disk repeats a request whose answer was lost: then the file there is this one.
            if not os.path.samestat(source.lstat(), destination.lstat()):
                raise
            source.unlink()
        except OSError:
            _claim(source, destination)
        else:
            source.unlink()
    sync_folder(destination.parent)


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder, where folders can be synced (not on Windows). Raises OSError."""
    if os.name == "nt":
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some network disks sync names by themselves
            raise
    finally:
        os.close(number)


def _claim(source: Path, destination: Path) -> None:
    """Rename where there are no hard links: claim the name by an empty file, then replace that one."""
    os.close(os.open(destination, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    try:
        # Another program may have written into the empty file: then it is that program's.
        if not _empty(destination):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(destination))
        source.replace(destination)
    except BaseException:
        with suppress(OSError):
            if _empty(destination):
                destination.unlink()
        raise


def _empty(path: Path) -> bool:
    return path.stat(follow_symlinks=False).st_size == 0
