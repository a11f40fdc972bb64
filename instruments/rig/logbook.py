"""State of a rig that outlasts a program: its audit log and its lockout."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ...base.errors import ConfigurationError
from ..config import RigFile, load_rig_file
from ..driver import Mode
from ..safety import Audit, clear_lockout, entries, lockout_of, lockouts_folder, reserve, state_folder
from .opening import hardware


def log_entries(rig: str | Path | RigFile, simulate: Mode | None = None) -> Iterator[Mapping[str, Any]]:
    """Read the audit log of rigs of this name, oldest entry first.

    `rig` and `simulate` are as in `open_rig`: a simulated rig has a separate log. A damaged line is an entry
    "damaged" of every rig. Raises ConfigurationError, and DataError for a log that cannot be read.
    """
    file = rig if isinstance(rig, RigFile) else load_rig_file(rig)
    folder = state_folder(file, (simulate or file.simulate) is not None)
    return (entry for entry in entries(folder) if entry.get("rig", file.name) == file.name)


def reset_lockout(rig: str | Path | RigFile, reason: str, simulate: Mode | None = None) -> None:
    """Clear the lockout of an inspected rig, once the reason is in its audit log.

    `rig` and `simulate` are as in `open_rig`. Raises ConfigurationError without a reason and for a rig that
    is not locked out, InstrumentError when another program has the rig.
    """
    file = rig if isinstance(rig, RigFile) else load_rig_file(rig)
    mode = simulate or file.simulate
    pieces = hardware(file, mode)
    with ExitStack() as stack:
        if mode is None:
            stack.enter_context(reserve(pieces, f"The rig {file.name!r}"))
        if not reason.strip():
            raise ConfigurationError(
                "A reset needs a reason: state the cause of the trip and what was done about it."
            )
        folder = state_folder(file, mode is not None)
        lockouts = lockouts_folder(folder, mode is not None)
        lockout = lockout_of(lockouts, pieces)
        if lockout is None:
            raise ConfigurationError(f"The rig {file.name!r} is not locked out: there is nothing to reset.")
        Audit(file, folder, mode is not None).note(
            "reset", reason=reason.strip(), locked_out=lockout.when, why=lockout.why
        )
        clear_lockout(lockouts, pieces)
