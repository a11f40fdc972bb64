"""The audit log of connections, plays, trips and activations with their users: one JSON object per line.

There is one append-only file per month. A line is one write to the operating system, and so survives
a killed program; on hardware it is synced to the disk before anything is played. Each line has a hash of its
own (`json_text`), because several programs append to one file.
"""

from __future__ import annotations

import getpass
import os
import platform
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import platformdirs

from ...base.clock import RealClock
from ...base.errors import ConfigurationError, DataError
from ...base.files import os_error_text
from ...base.json_files import as_line, from_text
from ...base.marks import release, taken

if TYPE_CHECKING:
    from ..config import RigFile

_LONGEST_LINE = 1 << 20
"""Bytes of a line that are read at once: a log without an end of line is damaged."""
_A_LINE = 0.01
"""Time in which a line is written (s)."""
_PATIENCE = 0.5
"""Time to wait for another program that appends a line (s); then the line is written all the same."""
_LONGEST = 200
"""Characters of a command line that are kept."""


def now_utc() -> datetime:
    """Wall-clock time: for people, never for a measurement."""
    return datetime.now(UTC)


class Audit:
    """The log of an open rig. `note` may be called from any thread."""

    def __init__(
        self, file: RigFile, folder: Path, simulated: bool, wall: Callable[[], datetime] = now_utc
    ) -> None:
        self._folder = folder
        self._wall = wall
        self._durable = not simulated
        self._about = {
            "rig": file.name,
            "rig_sha256": file.digest,
            "simulated": simulated,
            **who(),
            "version": metadata.version("haploop"),
        }

    @property
    def folder(self) -> Path:
        """The rig's state folder."""
        return self._folder

    def note(self, kind: str, **fields: Any) -> None:
        """Append a line; `fields` are of JSON's types. Raises DataError when it cannot be written."""
        now = self._wall()
        time = now.isoformat(timespec="milliseconds")
        try:
            line = as_line({"time": time, "kind": kind, **fields, **self._about}).encode()
        except (ValueError, TypeError):
            raise DataError(f"{kind!r} cannot be logged: {fields} is not of JSON's types.") from None
        path = self._folder / f"log-{now:%Y-%m}.jsonl"
        try:
            make_folder(self._folder)
            log = _opened(path)
            try:
                with _alone(log):
                    if _is_torn(log):
                        line = b"\n" + line
                    while line:
                        # A disk that takes a part says why with the rest.
                        line = line[os.write(log, line) :]
                if self._durable:
                    os.fsync(log)
            finally:
                os.close(log)
        except OSError as error:
            raise DataError(
                f"The audit log {path} cannot be written ({os_error_text(error)}), and nothing is played "
                "without it: free disk space, or set HAPLOOP_STATE to a writable folder."
            ) from None

    def note_at_last(self, kind: str, **fields: Any) -> None:
        """Append a line as `note`, but ignore a failure to write: for the way to the safe state."""
        with suppress(DataError):
            self.note(kind, **fields)


def make_folder(path: Path) -> None:
    """Make a folder with the rights of the one that it is in, of several users perhaps. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with suppress(FileExistsError):
        path.mkdir()
        path.chmod(stat.S_IMODE(path.parent.stat().st_mode))


def entries(folder: Path) -> Iterator[Mapping[str, Any]]:
    """Every entry of a folder's logs, oldest first.

    A line that was torn, damaged or changed by hand is an entry "damaged" without any rig. Raises DataError
    for a log that cannot be read.
    """
    for path in sorted(folder.glob("log-*.jsonl")):
        yield from _entries(path)


def log_problems(path: Path) -> tuple[str, ...]:
    """One sentence for a log with damaged lines, none for an intact one. Raises DataError."""
    damaged = [str(entry["why"]) for entry in _entries(path) if "rig" not in entry]
    return (
        (f"{path} has {len(damaged)} damaged line{'s' * (len(damaged) > 1)}. {damaged[0]}",)
        if damaged
        else ()
    )


def _opened(path: Path) -> int:
    """Open a log to append to it; a new one can be written by those who can write its folder."""
    flags = os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0)
    # In a shared folder, Linux refuses O_CREAT for another user's file, even if it exists.
    try:
        return os.open(path, flags)
    except FileNotFoundError:
        log = os.open(path, flags | os.O_CREAT, 0o666)
        with suppress(OSError):  # another user's, made meanwhile
            path.chmod(path.parent.stat().st_mode & 0o666)
        return log


@contextmanager
def _alone(log: int) -> Iterator[None]:
    """Keep other programs from appending: Windows' C library looks for the end first, and then writes.

    Elsewhere a write appends in one step, and nobody has to wait.
    """
    if os.name != "nt":
        yield
        return
    clock = RealClock()
    until = clock.now() + _PATIENCE
    while not (locked := taken(log)) and clock.now() < until:
        clock.sleep(0.001)
    try:
        yield
    finally:
        if locked:
            release(log)


def _is_torn(log: int) -> bool:
    """True when the last line has no end, and nobody is writing it: after a power cut or on a full disk."""
    if not _is_cut(log):
        return False
    RealClock().sleep(_A_LINE)
    return _is_cut(log)


def _is_cut(log: int) -> bool:
    """True when the last line has no end now."""
    os.lseek(log, max(0, os.lseek(log, 0, os.SEEK_END) - 1), os.SEEK_SET)
    return os.read(log, 1) not in (b"", b"\n")


def _entries(path: Path) -> Iterator[Mapping[str, Any]]:
    try:
        with path.open("rb") as lines:
            for number, line in enumerate(iter(lambda: lines.readline(_LONGEST_LINE), b""), start=1):
                if line == b"\n":  # a line seemed torn that another program was long in writing
                    continue
                try:
                    entry = from_text(line)
                    if not entry.keys() >= {"time", "kind", "rig"}:
                        raise ValueError("not of this log")
                    yield entry
                except ValueError:
                    why = f"Line {number} of {path.name} was torn, damaged or changed by hand."
                    yield {"kind": "damaged", "why": why}
    except OSError as error:
        raise DataError(f"The audit log {path} cannot be read: {os_error_text(error)}.") from None


def who() -> dict[str, object]:
    """Identify this program: user, host, process and command."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):
        user = "unknown"
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]) if sys.argv else "python"
    return {"user": user, "host": platform.node(), "pid": os.getpid(), "command": command[:_LONGEST]}


def state_folder(file: RigFile, simulated: bool) -> Path:
    """Folder of a rig's log and lockouts: HAPLOOP_STATE, else `state` of its file, else the user's own.

    Simulated rigs have a separate folder; when the user's cannot be written (on a build machine, for
    example), it is in the folder for temporary files. Raises ConfigurationError.
    """
    given = os.environ.get("HAPLOOP_STATE") or file.state
    try:
        folder = Path(given) if given else platformdirs.user_state_path("haploop")
        folder = folder.expanduser().absolute() / ("simulated" if simulated else "rigs")
        make_folder(folder)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(13, "permission denied")
    except (OSError, RuntimeError) as error:
        why = os_error_text(error) if isinstance(error, OSError) else str(error).rstrip(".")
        if simulated and not given:
            return Path(tempfile.gettempdir()) / f"haploop-state-{who()['user']}" / "simulated"
        raise ConfigurationError(
            f"haploop keeps its audit log in {given or 'the user state folder'}, which cannot "
            f"be written ({why}): set HAPLOOP_STATE to a writable folder."
        ) from None
    return folder
