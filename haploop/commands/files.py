"""`haploop show`, `recover`: what a file holds, and a file made whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.commands.options import JSON, PATH

if TYPE_CHECKING:
    pass

__all__ = ["recover", "show"]


@click.command()
@click.argument("file", type=PATH)
@click.option("--plot", type=PATH, metavar="OUT.png", help="Also draw it.")
@JSON
def show(file: Path, plot: Path | None, as_json: bool) -> int:
    """What is in a recording, a representative press, a calibration or a drive FILE."""
    from haploop import show as display  # noqa: PLC0415

    display.show(file, as_json, plot)
    return 0


@click.command()
@click.argument("file", type=PATH)
@JSON
def recover(file: Path, as_json: bool) -> int:
    """Make an interrupted recording FILE whole, in a new file beside it."""
    import acquisition  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415

    display.show(acquisition.recover(file), as_json)
    return 0
