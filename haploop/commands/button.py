"""`haploop button make`, `check`: the digital button as one file, made and verified."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from haploop.commands.options import JSON, PATH, RIG, SIMULATE, alone, opened_rig
from haploop.exits import Session

if TYPE_CHECKING:
    from instruments.driver import Mode

__all__ = ["button"]


@click.group(no_args_is_help=True)
def button() -> None:
    """Make a digital button, or verify one by playing it."""


@button.command()
@click.argument("recordings", nargs=-1, required=True, type=PATH)
@click.option(
    "--calibration", "-c", required=True, type=PATH, metavar="FILE", help="As `haploop calibrate` wrote it."
)
@click.option("--out", "-o", type=PATH, default=Path("button.h5"), show_default=True, metavar="FILE.h5")
@click.option(
    "--method",
    type=click.Choice(["modulated", "broadband"]),
    default="modulated",
    show_default=True,
    help="The press modulated with the table's resonance, as in the paper, or the press itself.",
)
@click.option(
    "--iterations",
    type=click.IntRange(0, 50),
    default=5,
    show_default=True,
    help="Corrections at most that are learnt from playing the drive.",
)
@RIG
@SIMULATE
@JSON
@click.pass_obj
def make(
    session: Session,
    recordings: Sequence[Path],
    calibration: Path,
    out: Path,
    method: Literal["modulated", "broadband"],
    iterations: int,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Make the digital button that stands for RECORDINGS of one button: drive, learning, check.

    Exit codes: 0 it passed its check, 1 it did not (the file is written and says why).
    """
    import haploop  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415
    from haploop.targets import new_file  # noqa: PLC0415

    new_file(out)
    table = haploop.Calibration.load(calibration)
    press = haploop.representative([haploop.Recording.open(path) for path in recordings])
    with (
        alone(rig, simulate) as file,
        opened_rig(session, file, simulate) as opened,
        Steps() as steps,
    ):
        made = haploop.build_button(
            opened, press, table, method=method, iterations=iterations, progress=steps
        )
    made.save(out)
    display.show(out, as_json)
    return 0 if made.passed else 1


@button.command()
@click.argument("file", type=PATH)
@RIG
@SIMULATE
@JSON
@click.pass_obj
def check(session: Session, file: Path, rig: str, simulate: Mode | None, as_json: bool) -> int:
    """Verify the digital button FILE by playing it on the rig that it was made on.

    Exit codes: 0 it passes, 1 it does not. The file stays as it is.
    """
    import haploop  # noqa: PLC0415
    from haploop import show as display  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415

    known = haploop.DigitalButton.load(file)
    with (
        alone(rig, simulate) as rig_file,
        opened_rig(session, rig_file, simulate) as opened,
        Steps() as steps,
    ):
        step = f"Play and measure the {known.press.button} button"
        result = haploop.play_button(opened, known, progress=lambda done, of: steps(step, done, of))
    display.check(known.press, result, as_json)
    return 0 if result.passed else 1
