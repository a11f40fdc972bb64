"""`haploop represent`: compute the representative press of recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..reports import contents, show
from . import front as haploop
from .options import AVERAGE, JSON, NEW, PATH

if TYPE_CHECKING:
    from ..acquisition import AverageMethod

__all__ = ["represent"]


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=PATH)
@click.option(
    "--out",
    "-o",
    type=NEW,
    default=Path("press.h5"),
    show_default=True,
    metavar="FILE.h5",
    help="Representative press file to write.",
)
@AVERAGE
@JSON
def represent(recordings: Sequence[Path], out: Path, average: AverageMethod, as_json: bool) -> int:
    """Compute the representative press of recordings.

    RECORDINGS are of one button, by any number of participants. The result states the method, the reason for
    it, and the residual of each method that was compared. For a study, use `haploop study represent`.
    """
    press = haploop.representative([haploop.Recording.open(path) for path in recordings], method=average)
    press.save(out)
    show.print_contents(contents.file_contents(out), as_json)
    return 0
