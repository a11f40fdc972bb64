"""`haploop show`, `list`, `report`, `recover`, `verify`: what is done with files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import click

from ..reports import contents
from ..reports import show as display
from ..terminal.browser import open_page
from ..terminal.progress import SIMULATED, Steps, note, print_json, print_line
from . import public as haploop
from .option_groups import Shown, showing
from .options import JSON, PATH


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@showing
def show(files: Sequence[Path], shown: Shown) -> int:
    """Show the contents of a file.

    FILE is a recording, a representative press, a calibration, a drive, a check, a digital button, a curve,
    or the folder of a vibration map or of a history of calibrations. For several recordings, or a study (its
    study.toml or its folder), show the force at activation by participant and button.
    """
    own = (files[0] / "map.json").is_file() or contents.is_history(files[0])
    if len(files) > 1 or (files[0].is_dir() and not own) or files[0].suffix == ".toml":
        found = contents.forces_contents(contents.recordings_in(files))
    else:
        found = contents.file_contents(files[0])
    shown.print(found)
    return 0


@click.command("list")
@click.argument("where", nargs=-1, metavar="[WHERE...]")
@click.option(
    "--in",
    "folders",
    multiple=True,
    type=PATH,
    metavar="DIR",
    help="Folder to search; repeatable.  [default: this folder]",
)
@click.option("--rebuild", is_flag=True, help="Read every file again, instead of the new and changed ones.")
@JSON
def list_command(where: Sequence[str], folders: Sequence[Path], rebuild: bool, as_json: bool) -> int:
    """List files by what is in them.

    WHERE is NAME=VALUE, NAME!=VALUE, NAME>=VALUE or NAME<=VALUE; all must hold. NAME is kind, participant,
    button, date, verdict, presses, rig, simulated, study, patch, point, file, content_hash or problem; in
    VALUE, * stands for anything. Files are verified when they are first read; damaged ones have
    kind=damaged.
    """
    with Steps() as steps:
        found = haploop.list_files(folders or [Path()], where, rebuild=rebuild, progress=steps)
    display.print_contents(contents.listing_contents(found), as_json)
    return 0


@click.command()
@click.argument("paths", nargs=-1, required=True, type=PATH, metavar="PATH...")
@click.option(
    "--out", "-o", type=PATH, default=Path("report.html"), show_default=True, help="HTML file to write."
)
@click.option("--no-open", is_flag=True, help="Do not open the report in a browser.")
@JSON
def report(paths: Sequence[Path], out: Path, no_open: bool, as_json: bool) -> int:
    """Write a report with verdicts, figures and captions.

    PATH is a recording, a representative press, a calibration, a drive, a check, a digital button, a curve,
    the folder of a vibration map or of a history of calibrations, a study (its study.toml or its folder), a
    folder of such files, or a table of `haploop experiment export` (CSV). OUT is one HTML file that needs no
    other file, for a browser. Each figure is beside it, as PDF, SVG and CSV, in OUT-figures.
    """
    if out.suffix.lower() not in (".html", ".htm"):
        raise haploop.ConfigurationError(f"{out} has the wrong file type: use a name that ends with .html.")
    with Steps() as steps:
        made = haploop.write_report(paths, out, steps)
    if as_json:
        print_json(
            {
                "report": str(made.html),
                "figures": [str(path) for path in made.figures],
                "simulated": made.simulated,
                "verdicts": [asdict(verdict) for verdict in made.verdicts],
            }
        )
        return 0
    if made.simulated:
        print_line(SIMULATED)
    print_line(f"Report: {made.html}")
    if made.figures:
        print_line(f"Figures as PDF, SVG and CSV: {made.figures[0].parent}")
    if not no_open:
        open_page(made.html)
    return 0


@click.command()
@click.argument("file", type=PATH)
@JSON
def recover(file: Path, as_json: bool) -> int:
    """Salvage the intact part of a recording.

    FILE was interrupted, truncated or damaged. The intact part is written beside it, into a new file with
    the suffix .recovered.h5; FILE is not changed.
    """
    saved = haploop.acquisition.recover(file)
    note(haploop.Recording.open(saved).events[-1].text)
    display.print_contents(contents.file_contents(saved), as_json)
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
                digest = haploop.acquisition.content_hash(file)
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
