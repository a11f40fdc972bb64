"""What is known of a rig: the findings of `haploop doctor`, and its audit log and lockout."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from typing import TYPE_CHECKING, Any

from ...instruments import RigFile, hardware, log_entries
from ...instruments.driver import Mode
from ...instruments.safety import lockout_of, lockouts_folder, state_folder
from .parts import Cell, Contents, Grid, Tone, fact

if TYPE_CHECKING:
    from ...calibration.self_test import Finding

_TONES: dict[str, Tone] = {"green": "good", "yellow": "doubtful", "red": "bad"}
"""Of each status, from the best to the worst."""
_WHO = ("rig", "rig_sha256", "simulated", "user", "host", "pid", "command", "version")
"""Fields of every entry that identify the program."""


def findings_contents(findings: Sequence[Finding], rig: str, simulated: bool) -> Contents:
    """Findings of an examination of the rig, one a line."""
    worst = max((finding.status for finding in findings), key=list(_TONES).index)
    rows = [
        (Cell(one.status, _TONES[one.status]), f"{one.name} ({one.instrument})", one.sentence)
        for one in findings
    ]
    title = f"The rig {rig}{', simulated' if simulated else ''}: {worst}"
    values = fact(rig=rig, status=worst, findings=[asdict(one) for one in findings])
    return Contents("", [values], [Grid(title, (), rows, words=3)], simulated=simulated, origin="")


def log_contents(file: RigFile, mode: Mode | None, last: int) -> Contents:
    """The last entries of the audit log for rigs of this name, and the lockout."""
    folder = state_folder(file, mode is not None)
    entries = list(deque(log_entries(file, mode), last))
    lockout = lockout_of(lockouts_folder(folder, mode is not None), hardware(file, mode))
    values = fact(rig=file.name, lockout=lockout and lockout.sentence, entries=entries)
    grid = Grid(f"The rig {file.name}: {folder}", (), list(_rows(entries)), words=3)
    said = lockout.sentence if lockout else "The rig is not locked out."
    notes = [] if entries else ["The log has no entries yet."]
    return Contents("", [values], [grid], [*notes, said])


def _rows(entries: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str | Cell, ...]]:
    program = None
    for entry in entries:
        if "rig" not in entry:  # a damaged line: nothing else is known of it
            yield "", str(entry["kind"]), str(entry["why"])
            continue
        when = _local(entry.get("time"))
        if program != (program := [entry.get(key) for key in _WHO]):
            by = f"{entry.get('user')}@{entry.get('host')}: {entry.get('command')}"
            about = f"process {entry.get('pid')}, rig file {str(entry.get('rig_sha256'))[:8]}"
            yield tuple(Cell(text, "aside") for text in (when, "program", f"{by} ({about})"))
        yield when, str(entry.get("kind")), _how(entry)


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
