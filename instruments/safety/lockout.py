"""The lockout of a rig: after an abort limit has stopped a play, every play is refused until a reset.

A lockout is set on every piece of the rig's hardware, not on its rig file: another or a renamed file
that names the same relay is locked out as well.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from haploop.instruments.errors import ConfigurationError
from haploop.instruments.files import whole_file

__all__ = ["Lockout", "clear_lockout", "lockout_of", "set_lockout"]


@dataclass(frozen=True)
class Lockout:
    """Record of a lockout: its time, its reason, and the user of the play that was stopped."""

    when: str
    """ISO 8601, UTC."""
    why: str
    who: str
    """User, host and process of the play that was stopped."""
    samples: str
    """File of the samples up to the trip."""

    @property
    def sentence(self) -> str:
        """Error message that refuses a play."""
        return (
            f"The rig is locked out: a play was stopped at {self.when} ({self.why.rstrip('.')}). "
            "Find the cause, and then run `haploop reset --reason '...'` with the --rig and --simulate of "
            "that play."
        )


def lockout_of(folder: Path, hardware: Collection[str]) -> Lockout | None:
    """The first lockout of any of these pieces of hardware; None when they have none.

    A file that cannot be read counts as a lockout.
    """
    for piece in sorted(hardware):
        path = _path(folder, piece)
        try:
            return Lockout(**json.loads(path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            continue
        except (OSError, ValueError, TypeError) as error:
            why = f"its lockout file {path} cannot be read: {error}"
            return Lockout("an unknown time", why, "unknown", "")
    return None


def set_lockout(folder: Path, hardware: Collection[str], lockout: Lockout) -> None:
    """Lock out these pieces of hardware; an earlier lockout is not overwritten. Raises OSError."""
    for piece in sorted(hardware):
        path = _path(folder, piece)
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError), whole_file(path) as part:
            part.write_text(json.dumps(asdict(lockout)), encoding="utf-8")


def clear_lockout(folder: Path, hardware: Collection[str]) -> None:
    """Clear every lockout of these pieces of hardware. Raises ConfigurationError."""
    for piece in hardware:
        path = _path(folder, piece)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise ConfigurationError(
                f"The lockout file {path} cannot be removed: {error.strerror}."
            ) from None


def _path(folder: Path, piece: str) -> Path:
    return folder / "lockouts" / f"{hashlib.sha256(piece.encode()).hexdigest()[:16]}.json"
