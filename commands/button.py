"""`haploop button make`, `check`: compute and verify a digital button."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from ..calibration import sizes
from ..instruments.files import reserved
from ..reports import outputs
from ..reports import show as display
from ..terminal.exits import CommandState
from ..terminal.progress import Steps
from . import front as haploop
from .options import (
    JSON,
    PATH,
    PLAYS,
    RIG,
    SIMULATE,
    alone,
    opened_rig,
    press_method,
)

if TYPE_CHECKING:
    from ..acquisition import AverageMethod
    from ..instruments.driver import Mode

__all__ = ["button"]


@click.group(no_args_is_help=True)
def button() -> None:
    """Make a digital button, or verify one on the table."""


@button.command()
@click.argument("presses", nargs=-1, required=True, type=PATH, metavar="PRESS...")
@click.option(
    "--calibration",
    "-c",
    required=True,
    type=PATH,
    metavar="FILE",
    help="Calibration file written by `haploop calibrate`.",
)
@click.option(
    "--out",
    "-o",
    type=PATH,
    default=Path("button.h5"),
    show_default=True,
    metavar="FILE.h5",
    help="Digital button file to write.",
)
@click.option(
    "--method",
    type=click.Choice(["modulated", "broadband"]),
    default="modulated",
    show_default=True,
    help="Method of the drive. modulated: the press modulated onto the table's resonance, as in the paper. "
    "broadband: the press itself.",
)
@click.option(
    "--iterations",
    type=click.IntRange(0, 50),
    default=5,
    show_default=True,
    help="Maximum number of iterative corrections of the drive.",
)
@press_method("--press-method")
@RIG
@SIMULATE
@JSON
@click.pass_obj
def make(
    state: CommandState,
    presses: Sequence[Path],
    calibration: Path,
    out: Path,
    method: Literal["modulated", "broadband"],
    iterations: int,
    press_method: AverageMethod,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Make a digital button from recordings of one physical button.

    PRESS is a recording (or several), or the file of a representative press (`haploop represent`, `haploop
    import`). Computes the representative press and the drive, corrects the drive by playing and measuring
    it, and checks the result.

    Exit codes: 0 the check passed, 1 it did not (the file is written and states why).
    """
    outputs.check_new_file(out)
    loaded = haploop.Calibration.load(calibration)
    press = haploop.load_press(presses, press_method)
    with (
        reserved(out, size=sizes.BUTTON + (iterations + 1) * sizes.STEP),
        alone(rig, simulate) as file,
        opened_rig(state, file, simulate) as opened,
        Steps() as steps,
    ):
        made = haploop.build_button(
            opened, press, loaded, method=method, iterations=iterations, progress=steps
        )
        made.save(out)
    display.show_file(out, as_json)
    return 0 if made.passed else 1


@button.command()
@click.argument("file", type=PATH)
@click.option(
    "--out",
    "-o",
    type=PATH,
    metavar="CHECK.h5",
    help="Check file to write.  [default: dated, in the folder checks]",
)
@PLAYS
@RIG
@SIMULATE
@JSON
@click.pass_obj
def check(
    state: CommandState,
    file: Path,
    out: Path | None,
    plays: int,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Play a digital button, measure it, and compare.

    The rig must be the one that FILE was made on. FILE is not changed; every play is kept in a check's file.

    Exit codes: 0 the check passed, 1 it failed or the plays do not show it.
    """
    loaded = haploop.DigitalButton.load(file)
    if out is None:
        out = outputs.dated_check(file.stem)
    else:
        outputs.check_new_file(out)
    with (
        reserved(out, size=sizes.CHECK + plays * sizes.PLAY),
        alone(rig, simulate) as rig_file,
        opened_rig(state, rig_file, simulate) as opened,
        Steps() as steps,
    ):
        result = haploop.play_button(opened, loaded, plays=plays, progress=steps)
        result.save(out)
    display.show_check(result, as_json, loaded.press, out)
    return 0 if result.passed else 1
