"""A rig's audit log and lockout, on standard output."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ...instruments import RigFile, hardware, log_entries
from ...instruments.driver import Mode
from ...instruments.safety import lockout_of, lockouts_folder, state_folder
from ...terminal.progress import note, print_json, print_line, print_table

__all__ = ["show_log"]

_WHO = ("rig", "rig_sha256", "simulated", "user", "host", "pid", "command", "version")
"""Fields of every entry that identify the program."""


def show_log(file: RigFile, mode: Mode | None, last: int, as_json: bool) -> None:
    """Print the last entries for rigs of this name, and the lockout."""
    folder = state_folder(file, mode is not None)
    found = deque(log_entries(file, mode), last)
    lockout = lockout_of(lockouts_folder(folder, mode is not None), hardware(file, mode))
    if as_json:
        print_json({"rig": file.name, "lockout": lockout and lockout.sentence, "entries": list(found)})
        return
    print_line(f"The rig {file.name}: {folder}")
    table = Table(box=SIMPLE, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    program = None
    for entry in found:
        if "rig" not in entry:  # a damaged line: nothing else is known of it
            table.add_row("", str(entry["kind"]), str(entry["why"]))
            continue
        when = _local(entry.get("time"))
        if program != (program := [entry.get(key) for key in _WHO]):
            by = f"{entry.get('user')}@{entry.get('host')}: {entry.get('command')}"
            about = f"process {entry.get('pid')}, rig file {str(entry.get('rig_sha256'))[:8]}"
            table.add_row(when, "program", f"{by} ({about})", style="dim")
        table.add_row(when, str(entry.get("kind")), _how(entry))
    if table.row_count:
        print_table(table)
    else:
        print_line("The log has no entries yet.")
    note(lockout.sentence if lockout else "The rig is not locked out.")


def _how(entry: Mapping[str, Any]) -> str:
    about = {key: value for key, value in entry.items() if key not in (*_WHO, "time", "kind")}
    match about:
        case {"patches": [*patches], "peak": float(peak), "seconds": float(seconds)}:
            return f"{peak:.4g} V peak for {seconds:.3g} s into {_plain(patches)}"
    return "; ".join(f"{key.replace('_', ' ')}: {_plain(value)}" for key, value in about.items())


def _plain(value: Any) -> str:
    """Format a JSON value as plain text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(one)}" for key, one in value.items() if one not in ("", None))
    if isinstance(value, list):
        return ", ".join(map(_plain, value)) or "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if value is None or isinstance(value, bool):
        return {True: "yes", False: "no", None: "-"}[value]
    return str(value)


def _local(time: Any) -> str:
    """Format an entry's time in the local time zone; other values are returned as text."""
    try:
        return f"{datetime.fromisoformat(str(time)).astimezone():%Y-%m-%d %H:%M:%S}"
    except ValueError:
        return str(time)
