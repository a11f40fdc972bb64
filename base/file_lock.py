"""A lock on an open file: the operating system releases it when the file is closed, or its program ends."""

from __future__ import annotations

import os
import sys

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
