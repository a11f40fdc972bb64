"""The files that `haploop list` found."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

from ...base.wording import capital
from ...exchange.catalogue import Entry, stated
from .parts import Contents, Grid, fact
from .words import counted

_COLUMNS = ("participant", "button", "date", "verdict", "presses")


def listing_contents(entries: Sequence[Entry]) -> Contents:
    """Entries, one a line in a table for each kind, and how many they are; simulated ones are marked."""
    rigs = {_rig(entry) for entry in entries if entry.rig}
    mixed = len(rigs) > 1 or len({entry.simulated for entry in entries} - {""}) > 1
    of_one = f", all of the rig {rigs.pop()}" if rigs and not mixed else ""
    of_kinds = groupby(sorted(entries, key=lambda entry: entry.kind), key=lambda entry: entry.kind)
    return Contents(
        "",
        [fact(files=[_plain(entry) for entry in entries])],
        [_grid(kind, list(some), mixed) for kind, some in of_kinds],
        [f"{counted(entries, 'file')}{of_one}.", *(entry.problem for entry in entries if entry.problem)],
    )


def _plain(entry: Entry) -> dict[str, Any]:
    """An entry as JSON values."""
    sources = [
        {"kind": one.kind, "name": one.name, "content_hash": one.content} for one in stated(entry.made_from)
    ]
    return asdict(entry) | {"made_from": sources}


def _grid(kind: str, entries: Sequence[Entry], with_rig: bool) -> Grid:
    """The table of one kind: files below their common folder, and the columns in which any has a word."""
    paths = [Path(entry.file) for entry in entries]
    try:
        folder = Path(os.path.commonpath([path.parent for path in paths]))
    except ValueError:  # on several drives of Windows
        folder = Path()
    columns = {"file": [str(path.relative_to(folder) if folder.parts else path) for path in paths]}
    columns |= {name: [_cell(entry, name) for entry in entries] for name in _COLUMNS}
    if with_rig:
        columns["rig"] = [_rig(entry) for entry in entries]
    said = {name: cells for name, cells in columns.items() if any(cells)}
    rows = list(zip(*said.values(), strict=True))
    title = f"{kind}, in {_near(folder)}" if folder.parts else kind
    return Grid(title, [capital(name) for name in said], rows, words=len(said))


def _cell(entry: Entry, name: str) -> str:
    said = str(getattr(entry, name))
    return said[:16].replace("T", " ") if name == "date" else said


def _rig(entry: Entry) -> str:
    marked = entry.simulated == "yes" and entry.rig != "simulated"
    return f"{entry.rig} (simulated)".strip() if marked else entry.rig


def _near(folder: Path) -> str:
    here = Path.cwd()
    return str(folder.relative_to(here)) if folder.is_relative_to(here) else str(folder)
