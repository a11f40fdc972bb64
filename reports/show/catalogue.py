"""The files that `haploop list` found, as a table and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import click
from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

from ...exchange.catalogue import Entry
from ...terminal.progress import print_json, print_line, print_table

__all__ = ["show_listing"]

_MANY = 300
"""Files from which lines are not fitted to the terminal: that takes 0.6 ms a row."""
_COLUMNS = ("kind", "participant", "button", "date", "verdict", "presses", "rig")


def show_listing(entries: Sequence[Entry], as_json: bool) -> None:
    """Print entries, one a line, and how many they are; simulated ones are marked."""
    if as_json:
        print_json({"files": [asdict(entry) for entry in entries]})
        return
    headings = [name.capitalize() for name in (*_COLUMNS, "file")]
    rows = [_cells(entry, Path.cwd()) for entry in entries]
    if len(rows) > _MANY:
        widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
        for row in (headings, *rows):
            click.echo("  ".join(map(str.ljust, row, widths)).rstrip())
    elif rows:
        table = Table(box=SIMPLE)
        for heading in headings:
            table.add_column(heading, overflow="fold")
        for row in rows:
            table.add_row(*map(Text, row))
        print_table(table)
    print_line(f"{len(entries)} file{'' if len(entries) == 1 else 's'}.")
    for entry in entries:
        if entry.problem:
            print_line(entry.problem)


def _cells(entry: Entry, here: Path) -> list[str]:
    cells = {name: str(getattr(entry, name)) for name in _COLUMNS}
    cells["date"] = cells["date"][:16].replace("T", " ")
    cells["rig"] += " (simulated)" if entry.simulated == "yes" and entry.rig != "simulated" else ""
    path = Path(entry.file)
    return [*cells.values(), str(path.relative_to(here)) if path.is_relative_to(here) else str(path)]
