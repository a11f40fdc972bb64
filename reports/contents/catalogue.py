"""The files that `haploop list` found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from ...exchange.catalogue import Entry
from .parts import Contents, Grid, fact
from .words import counted

__all__ = ["listing_contents"]

_COLUMNS = ("kind", "participant", "button", "date", "verdict", "presses", "rig")


def listing_contents(entries: Sequence[Entry]) -> Contents:
    """Entries, one a line, and how many they are; simulated ones are marked."""
    headings = [name.capitalize() for name in (*_COLUMNS, "file")]
    rows = [_cells(entry, Path.cwd()) for entry in entries]
    return Contents(
        "",
        [fact(files=[asdict(entry) for entry in entries])],
        [Grid("", headings, rows, words=len(headings))] if rows else [],
        [f"{counted(entries, 'file')}.", *(entry.problem for entry in entries if entry.problem)],
    )


def _cells(entry: Entry, here: Path) -> list[str]:
    cells = {name: str(getattr(entry, name)) for name in _COLUMNS}
    cells["date"] = cells["date"][:16].replace("T", " ")
    cells["rig"] += " (simulated)" if entry.simulated == "yes" and entry.rig != "simulated" else ""
    path = Path(entry.file)
    return [*cells.values(), str(path.relative_to(here)) if path.is_relative_to(here) else str(path)]
