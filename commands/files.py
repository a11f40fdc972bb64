"""`haploop show`, `recover`, `verify`: display, recover and verify files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

from ..reports import show as display
from ..terminal.progress import note, print_json, print_line
from . import front as haploop
from .options import COLUMNS, JSON, PATH

__all__ = ["recover", "show", "verify"]


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option(
    "--plot",
    type=PATH,
    metavar="OUT.png",
    help="Also draw a plot into this file, which ends with .png, .pdf or .svg.",
)
@COLUMNS
@JSON
def show(files: Sequence[Path], plot: Path | None, columns: Literal[1, 2], as_json: bool) -> int:
    """Show the contents of a file.

    FILE is a recording, a representative press, a calibration, a drive, a check, a digital button, or the
    folder of a vibration map. For several recordings, or a study (its study.toml or its folder), show the
    force at activation by participant and button.
    """
    a_map = (files[0] / "map.json").is_file()
    if len(files) > 1 or (files[0].is_dir() and not a_map) or files[0].suffix == ".toml":
        display.show_forces(files, as_json, plot, columns)
    else:
        display.show_file(files[0], as_json, plot, columns)
    return 0


@click.command()
@click.argument("file", type=PATH)
@JSON
def recover(file: Path, as_json: bool) -> int:
    """Salvage the intact part of a recording.

    FILE was interrupted, truncated or damaged. The intact part is written beside it, into a new file with
    the suffix .recovered.h5; FILE is not changed.
    """
    saved = haploop.recover(file)
    note(haploop.Recording.open(saved).events[-1].text)
    display.show_file(saved, as_json)
    return 0


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="PATH...")
@JSON
def verify(files: Sequence[Path], as_json: bool) -> int:
    """Verify files.

    PATH is a recording, or any other file that haploop writes: a representative press, a calibration, a
    drive, a check, a digital button, a point of a map, a session of an experiment, a part of a processed
    study; or a folder, for every .h5 file in it and in its folders. Checks the content hash of each, and the
    continuity and the structure of a recording.

    Exit codes: 0 all files are intact, 1 a readable recording has problems, 2 a file cannot be read.
    """
    worst, told = 0, []
    for file in [one for path in files for one in (_within(path) if path.is_dir() else [path])]:
        digest = None
        try:
            problems = haploop.verify(file)
            status = "damaged" if problems else "intact"
            if not problems:
                digest = haploop.content_hash(file)
        except haploop.DataError as error:
            problems, status = (str(error),), "unreadable"
        worst = max(worst, {"intact": 0, "damaged": 1, "unreadable": 2}[status])
        told.append({"file": str(file), "status": status, "problems": list(problems), "content_hash": digest})
        if not as_json:
            print_line(" ".join(problems) or f"{file} is intact: SHA-256 {digest}.")
    if as_json:
        print_json({"files": told})
    return worst


_VERIFIED = ("*.h5", "session-*.jsonl", "withdrawals.jsonl", "marks.json")
"""Files of a folder that are verified: recordings and what is made of them, and answers of experiments."""


def _within(folder: Path) -> list[Path]:
    named = (path for pattern in _VERIFIED for path in folder.rglob(pattern))
    found = sorted(path for path in named if not path.name.startswith("."))
    if not found:
        raise haploop.DataError(f"{folder} holds no .h5 file and no answers: name one that does, or files.")
    return found
