"""`haploop list`: which files lie in some folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from ..reports import contents, show
from ..terminal.progress import Steps
from . import front as haploop
from .options import JSON, PATH

__all__ = ["list_command"]


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
    show.print_contents(contents.listing_contents(found), as_json)
    return 0
