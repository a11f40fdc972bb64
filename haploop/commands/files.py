"""`haploop show`, `recover`, `verify`: display, recover and verify files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from haploop.commands.options import JSON, PATH

__all__ = ["recover", "show", "verify"]


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option("--plot", type=PATH, metavar="OUT.png", help="Also draw a plot into this file.")
@JSON
def show(files: Sequence[Path], plot: Path | None, as_json: bool) -> int:
    """Show the contents of a file.

    FILE is a recording, a representative press, a calibration, a drive, a digital button, or the folder of
    a vibration map. For several recordings, or a study (its study.toml or its folder), show the force at
    activation by participant and button.
    """
    from haploop.show import show as display  # noqa: PLC0415
    from haploop.show.study import show_forces  # noqa: PLC0415

    a_map = (files[0] / "map.json").is_file()
    if len(files) > 1 or (files[0].is_dir() and not a_map) or files[0].suffix == ".toml":
        show_forces(files, as_json, plot)
    else:
        display.show(files[0], as_json, plot)
    return 0


@click.command()
@click.argument("file", type=PATH)
@JSON
def recover(file: Path, as_json: bool) -> int:
    """Salvage the intact part of a recording.

    FILE was interrupted, truncated or damaged. The intact part is written beside it, into a new file with
    the suffix .recovered.h5; FILE is not changed.
    """
    from haploop import acquisition  # noqa: PLC0415
    from haploop.progress import note  # noqa: PLC0415
    from haploop.show import show as display  # noqa: PLC0415

    saved = acquisition.recover(file)
    note(acquisition.Recording.open(saved).events[-1].text)
    display.show(saved, as_json)
    return 0


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@JSON
def verify(files: Sequence[Path], as_json: bool) -> int:
    """Verify files.

    FILE is a recording, or any other file that haploop writes: a representative press, a calibration, a
    drive, a check, a digital button, a point of a map. Checks the content hash of each, and the continuity
    and the structure of a recording.

    Exit codes: 0 all files are intact, 1 a readable recording has problems, 2 a file cannot be read.
    """
    from haploop import acquisition  # noqa: PLC0415
    from haploop.acquisition import hdf5  # noqa: PLC0415
    from haploop.instruments import DataError  # noqa: PLC0415
    from haploop.progress import print_json, print_line  # noqa: PLC0415

    worst, told = 0, []
    for file in files:
        digest = None
        try:
            problems = acquisition.verify(file)
            status = "damaged" if problems else "intact"
            if not problems:
                digest = hdf5.content_hash(file)
        except DataError as error:
            problems, status = (str(error),), "unreadable"
        worst = max(worst, {"intact": 0, "damaged": 1, "unreadable": 2}[status])
        told.append({"file": str(file), "status": status, "problems": list(problems), "content_hash": digest})
        if not as_json:
            print_line(" ".join(problems) or f"{file} is intact: SHA-256 {digest}.")
    if as_json:
        print_json({"files": told})
    return worst
