"""`haploop show`, `recover`, `verify`: what a file holds, a file made whole, and whether it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from haploop.commands.options import JSON, PATH

__all__ = ["recover", "show", "verify"]


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option("--plot", type=PATH, metavar="OUT.png", help="Also draw it.")
@JSON
def show(files: Sequence[Path], plot: Path | None, as_json: bool) -> int:
    """What is in a recording, a representative press, a calibration or a drive FILE, or a map's folder.

    Of several recordings, or of a study (its study.toml or its folder): the force at activation, by
    participant and button.
    """
    from haploop import show as display  # noqa: PLC0415
    from haploop.show_study import show_forces  # noqa: PLC0415

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
    """Save what is whole of an interrupted or cut short recording FILE, in a new file beside it."""
    import acquisition  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import note  # noqa: PLC0415

    saved = acquisition.recover(file)
    note(acquisition.Recording.open(saved).events[-1].text)
    display.show(saved, as_json)
    return 0


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@JSON
def verify(files: Sequence[Path], as_json: bool) -> int:
    """Compare recordings with their content hash, and look for gaps and for what should not be there.

    Exit codes: 0 all are whole, 1 something is wrong with one that can be read, 2 one cannot be read.
    """
    import acquisition  # noqa: PLC0415
    from haploop.console import print_json, print_line  # noqa: PLC0415
    from instruments import DataError  # noqa: PLC0415

    worst, told = 0, []
    for file in files:
        digest = None
        try:
            problems = acquisition.verify(file)
            status = "wrong" if problems else "whole"
            if not problems:
                digest = acquisition.Recording.open(file).content_hash
        except DataError as error:
            problems, status = (str(error),), "unreadable"
        worst = max(worst, {"whole": 0, "wrong": 1, "unreadable": 2}[status])
        told.append({"file": str(file), "status": status, "problems": list(problems), "content_hash": digest})
        if not as_json:
            print_line(" ".join(problems) or f"{file} is whole: SHA-256 {digest}.")
    if as_json:
        print_json({"files": told})
    return worst
