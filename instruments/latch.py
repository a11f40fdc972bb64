"""The latch of a rig: once a play has been stopped by a limit, nothing is played until a person says so.

A latch hangs on every piece of hardware that the rig consists of, not on its rig file: another file
that names the same relay, or a renamed one, is latched as well.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path

from instruments.errors import ConfigurationError

__all__ = ["Latch", "hang", "latch_of", "lift"]


@dataclass(frozen=True)
class Latch:
    """Why nothing is played."""

    when: str
    """ISO 8601, UTC."""
    why: str
    who: str
    """User, host and process that played."""
    samples: str
    """File that holds the samples around it."""

    @property
    def sentence(self) -> str:
        """What a person is told who wants to play."""
        return (
            f"Nothing is played on this rig since a play was stopped at {self.when} "
            f"({self.why.rstrip('.')}): find out why, and then give `haploop reset --reason '...'` with "
            "this rig."
        )


def latch_of(folder: Path, hardware: Collection[str]) -> Latch | None:
    """The first latch that hangs on any of these pieces of hardware. Raises ConfigurationError.

    One that cannot be read is a latch all the same.
    """
    for piece in sorted(hardware):
        path = _path(folder, piece)
        try:
            return Latch(**json.loads(path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            continue
        except (OSError, ValueError, TypeError) as error:
            return Latch("an unknown time", f"its latch {path} cannot be read: {error}", "unknown", "")
    return None


def hang(folder: Path, hardware: Collection[str], latch: Latch) -> None:
    """Latch these pieces of hardware; what hangs there already stays. Raises OSError."""
    for piece in sorted(hardware):
        path = _path(folder, piece)
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            continue
        new = path.with_suffix(f".{os.getpid()}")
        new.write_text(json.dumps(asdict(latch)), encoding="utf-8")
        new.replace(path)


def lift(folder: Path, hardware: Collection[str]) -> None:
    """Take every latch off these pieces of hardware. Raises ConfigurationError."""
    for piece in hardware:
        path = _path(folder, piece)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise ConfigurationError(f"The latch {path} cannot be removed: {error.strerror}.") from None


def _path(folder: Path, piece: str) -> Path:
    return folder / "latched" / f"{hashlib.sha256(piece.encode()).hexdigest()[:16]}.json"
