"""`haploop represent`: compute the representative press of recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..reports import outputs
from ..reports import show as display
from . import front as haploop
from .options import JSON, PATH, press_method

if TYPE_CHECKING:
    from ..acquisition import AverageMethod

__all__ = ["represent"]


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=PATH)
@click.option(
    "--out",
    "-o",
    type=PATH,
    default=Path("press.h5"),
    show_default=True,
    metavar="FILE.h5",
    help="Representative press file to write.",
)
@press_method("--method", "-m")
@JSON
def represent(recordings: Sequence[Path], out: Path, press_method: AverageMethod, as_json: bool) -> int:
    """Compute the representative press of recordings.

    RECORDINGS are of one button, by any number of participants. The result states the method, the reason for
    it, and the residual of each method that was compared. For a study, use `haploop study represent`.
    """
    outputs.check_new_file(out)
    press = haploop.representative([haploop.Recording.open(path) for path in recordings], method=press_method)
    press.save(out)
    display.show_file(out, as_json)
    return 0
