"""A rig's audit log and lockout, on standard output."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from rich.markup import escape
from rich.table import Table

from haploop.instruments import RigFile, hardware, log_entries
from haploop.instruments.driver import Mode
from haploop.instruments.safety import lockout_of, state_folder
from haploop.progress import note, print_json, print_table

__all__ = ["show_log"]

_WHO = ("rig", "rig_sha256", "simulated", "user", "host", "pid", "command", "version")
"""What every entry says of its program."""


def show_log(file: RigFile, mode: Mode | None, last: int, as_json: bool) -> None:
    """Print the last entries that programs have made for rigs of this name, and the lockout."""
    folder = state_folder(file, mode is not None)
    found = deque(log_entries(file, mode), last)
    lockout = lockout_of(folder, hardware(file, mode))
    if as_json:
        print_json({"rig": file.name, "lockout": lockout and lockout.sentence, "entries": list(found)})
        return
    table = Table("when", "what", "how", "who", "rig file", title=f"The rig {file.name}: {folder}")
    for entry in found:
        when = datetime.fromisoformat(str(entry.get("time"))).astimezone()
        table.add_row(
            f"{when:%Y-%m-%d %H:%M:%S}",
            str(entry.get("kind")),
            escape(_how(entry)),
            escape(f"{entry.get('user')}@{entry.get('host')}: {entry.get('command')}"),
            str(entry.get("rig_sha256"))[:8],
        )
    print_table(table)
    note(lockout.sentence if lockout else "The rig is not locked out.")


def _how(entry: Mapping[str, Any]) -> str:
    about = {key: value for key, value in entry.items() if key not in (*_WHO, "time", "kind")}
    if entry.get("kind") == "played":
        patches = ", ".join(about.get("patches", ()))
        return f"{about.get('peak', 0):.4g} V peak for {about.get('seconds', 0):.3g} s into {patches}"
    return "; ".join(f"{key}: {value}" for key, value in about.items())
