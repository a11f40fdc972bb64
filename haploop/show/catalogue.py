"""The files that `haploop list` found, as a table and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

from haploop.catalogue import Entry
from haploop.progress import print_json, print_line, print_table

__all__ = ["show_listing"]

_COLUMNS = ("kind", "participant", "button", "date", "verdict", "presses", "rig")


def show_listing(entries: Sequence[Entry], as_json: bool) -> None:
    """Print entries, one a line, and how many they are; simulated ones are marked."""
    if as_json:
        print_json({"files": [asdict(entry) for entry in entries]})
        return
    table = Table(box=SIMPLE)
    for name in (*_COLUMNS, "file"):
        table.add_column(name.capitalize(), overflow="fold")
    here = Path.cwd()
    for entry in entries:
        cells = {name: str(getattr(entry, name)) for name in _COLUMNS}
        cells["date"] = cells["date"][:16].replace("T", " ")
        cells["rig"] += " (simulated)" if entry.simulated == "yes" and entry.rig != "simulated" else ""
        path = Path(entry.file)
        shown = str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
        table.add_row(*(Text(cells[name]) for name in _COLUMNS), Text(shown))
    if entries:
        print_table(table)
    print_line(f"{len(entries)} file{'' if len(entries) == 1 else 's'}.")
    for entry in entries:
        if entry.problem:
            print_line(entry.problem)
