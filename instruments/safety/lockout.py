"""The lockout of a rig: every play is refused until a reset.

It follows an abort limit that has stopped a play, and volts on an output that this rig had set to zero.

A lockout is set on every piece of the rig's hardware, not on its rig file: another or a renamed file
that names the same relay is locked out as well, for every user of the computer. That of a simulated rig is
kept with its audit log.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from ...base.errors import ConfigurationError
from ...base.json_files import as_file, of_file
from . import machine
from .audit import Audit, now_utc, who

_KIND = "lockout"
_SELDOM = 60.0
"""Longest interval (s) at which volts that stand again and again are logged."""


@dataclass(frozen=True)
class Lockout:
    """Record of a lockout: its time, its reason, and who used the rig."""

    when: str
    """ISO 8601, UTC."""
    why: str
    who: str
    """User, host and process."""
    samples: str
    """File of the samples up to a trip; "" without one."""

    @property
    def sentence(self) -> str:
        """Error message that refuses a play."""
        return (
            f"The rig is locked out since {self.when} ({self.why.rstrip('.')}). "
            "Find the cause, and then run `haploop reset --reason '...'` with the same --rig and --simulate."
        )


def lockouts_folder(audit: Path, simulated: bool) -> Path:
    """Folder of a rig's lockouts: this computer's, or the one of a simulated rig's audit log.

    Raises InstrumentError.
    """
    return audit if simulated else machine.folder()


def lockout_of(folder: Path, hardware: Collection[str]) -> Lockout | None:
    """The first lockout of any of these pieces of hardware; None when they have none.

    A file that cannot be read, or does not match its hash, counts as a lockout.
    """
    for piece in sorted(hardware):
        path = _path(folder, piece)
        try:
            found = of_file(_KIND, machine.read(path))
            if found is not None:
                return Lockout(**found)
        except FileNotFoundError:
            continue
        except OSError as error:
            return _unknown(f"its lockout file {path} cannot be read: {error.strerror}")
        except (ValueError, TypeError):
            return _unknown(f"its lockout file {path} is damaged or was changed by hand")
    return None


class Lockouts:
    """The lockouts of one rig's hardware, in a folder, and the log that tells of them."""

    def __init__(self, folder: Path, hardware: Collection[str], audit: Audit) -> None:
        self.folder, self.hardware, self.audit = folder, hardware, audit
        self._unsaved: Lockout | None = None
        """One that could not be written to disk: it lasts while the rig is open."""
        self._quiet, self._quiet_until = 0.1, -math.inf

    @property
    def present(self) -> Lockout | None:
        """The lockout that refuses every play; None without one."""
        return self._unsaved or lockout_of(self.folder, self.hardware)

    def logged(self, now: float) -> bool:
        """Whether a trip at `now` (s) is already logged: again while locked out, at intervals that double."""
        if now < self._quiet_until and self.present is not None:
            return True
        self._quiet = min(2 * self._quiet, _SELDOM)
        self._quiet_until = now + self._quiet
        return False

    def lock_out(self, why: str, samples: Path | None = None) -> None:
        """Lock out the hardware now, and log it: each even when the other fails."""
        person = who()
        by = f"{person['user']} on {person['host']}, process {person['pid']} ({person['command']})"
        lockout = Lockout(now_utc().isoformat(timespec="seconds"), why, by, str(samples or ""))
        self._unsaved = lockout
        with suppress(OSError):
            set_lockout(self.folder, self.hardware, lockout)
            self._unsaved = None
        self.audit.note_at_last("tripped", why=why, samples=lockout.samples)


def set_lockout(folder: Path, hardware: Collection[str], lockout: Lockout) -> None:
    """Lock out these pieces of hardware; an earlier lockout is not overwritten. Raises OSError."""
    for piece in sorted(hardware):
        if lockout_of(folder, {piece}) is None:
            folder.mkdir(parents=True, exist_ok=True)
            machine.write(_path(folder, piece), _text(asdict(lockout)))


def clear_lockout(folder: Path, hardware: Collection[str]) -> None:
    """Clear every lockout of these pieces of hardware. Raises ConfigurationError."""
    for piece in hardware:
        path = _path(folder, piece)
        try:
            machine.read(path)
            # Another user's cannot be removed from a shared folder.
            machine.write(path, _text(None))
        except FileNotFoundError:
            continue
        except OSError as error:
            raise ConfigurationError(
                f"The lockout file {path} cannot be cleared ({error.strerror}): remove what is there."
            ) from None


def _text(content: dict[str, str] | None) -> bytes:
    return as_file(_KIND, content)[0].encode()


def _unknown(why: str) -> Lockout:
    return Lockout("an unknown time", why, "unknown", "")


def _path(folder: Path, piece: str) -> Path:
    return folder / machine.file_for(piece, "lockout")
