"""Locks on open files: mark a file as being written by one program, and keep the locks of this process."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .clock import RealClock
from .errors import InstrumentError

_LOOKS = 20
"""Attempts to take a mark, a millisecond apart: a program that tests it holds it for an instant."""

held_open: dict[object, int] = {}
"""Descriptors of the files whose locks this process holds."""


def _forked() -> None:
    """Leave every lock to the parent: a lock lasts as long as any process has the open file."""
    for descriptor in held_open.values():
        with suppress(OSError):
            os.close(descriptor)
    held_open.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


class InUse(InstrumentError):  # noqa: N818
    """Another program has the rig, or the file."""


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
        if taken_here and still(mark, descriptor):
            break
        _close(mark, descriptor)
        if not taken_here:
            raise InUse(f"{path} is being written by another program: wait until it has ended, or end it.")
    else:
        raise InUse(f"{path} is being written by other programs, one after the other: try again.")
    with keeping(descriptor, mark):
        yield


@contextmanager
def keeping(descriptor: int, path: Path) -> Iterator[None]:
    """Keep a locked file, then remove it and close it; a forked child does neither."""
    token = object()
    held_open[token] = descriptor
    try:
        yield
    finally:
        if held_open.pop(token, None) is not None:
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


def still(mark: Path, descriptor: int) -> bool:
    """Whether an open mark has its name still. On Windows no file that is open loses it."""
    if sys.platform == "win32":
        return True
    try:
        return os.path.samestat(os.fstat(descriptor), mark.stat())
    except FileNotFoundError:
        return False


def _mark_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


# A lock on an open file: the operating system releases it when the file is closed, or its program ends.

__all__ = ["release", "taken"]

_BEYOND = 1 << 30
"""Offset of the byte that is locked on Windows: past the content, which others must be able to read."""

if sys.platform == "win32":
    import msvcrt

    def taken(descriptor: int, shared: bool = False) -> bool:
        """Lock a file. False when another program has it, or this one by another descriptor.

        Windows' C library has no shared lock: a shared one may last for an instant only.
        """
        return _done(descriptor, msvcrt.LK_NBLCK)

    def release(descriptor: int) -> None:
        """Release the lock of a file that stays open."""
        _done(descriptor, msvcrt.LK_UNLCK)

    def _done(descriptor: int, how: int) -> bool:
        os.lseek(descriptor, _BEYOND, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, how, 1)
        except OSError:
            return False
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
        return True

else:
    import fcntl

    # Not lockf: its lock is released when any descriptor of the file is closed.

    def taken(descriptor: int, shared: bool = False) -> bool:
        """Lock a file. False when another program has it, or this one by another descriptor."""
        try:
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def release(descriptor: int) -> None:
        """Release the lock of a file that stays open."""
        fcntl.flock(descriptor, fcntl.LOCK_UN)
