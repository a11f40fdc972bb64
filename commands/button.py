"""`haploop button make`, `under`, `check`: compute and verify a digital button."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import click

from ..base.files import reserved
from ..calibration import sizes
from ..instruments.operator import RestFinger
from ..reports import contents, outputs, show
from ..terminal.progress import Steps
from . import public as haploop
from .option_groups import (
    AskedElsewhere,
    AskedPlays,
    AskedPress,
    Shown,
    on_elsewhere,
    on_plays,
    on_press,
    showing,
)
from .options import EXITS, JSON, NEW, PATH, PLAYS, ChosenRig, Measure, on_rig

ERROR = click.option(
    "--error",
    type=Measure("%", 0.01),
    metavar="PERCENT",
    help="As loud as the limits allow with this error expected, for example 5.",
)
LEVEL = click.option(
    "--level",
    type=Measure("dB"),
    metavar="DB",
    help="At least so far above the threshold of a finger that presses, for example 10dB.",
)
DRIFT = click.option(
    "--drift",
    type=Measure("%", 0.01),
    metavar="PERCENT",
    help="Drift of all resonances that is planned against, dampings and the rest in proportion: a "
    "smaller one is louder.  [default: 1 with several patches, none with one]",
)


@click.group(no_args_is_help=True)
def button() -> None:
    """Make a digital button, or verify one on the table."""


@button.command()
@on_press
@click.option(
    "--out",
    "-o",
    type=NEW,
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
@on_elsewhere
@ERROR
@LEVEL
@DRIFT
@on_rig()
@JSON
def make(
    asked: AskedPress,
    elsewhere: AskedElsewhere,
    out: Path,
    method: Literal["modulated", "broadband"],
    iterations: int,
    error: float | None,
    level: float | None,
    drift: float | None,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Make a digital button from recordings of one physical button.

    PRESS is a recording (or several), or the file of a representative press (`haploop represent`, `haploop
    import`). Computes the representative press and the drive, corrects the drive by playing and measuring
    it, and checks the result. `--error` and `--level` choose between likeness and loudness (`haploop button
    plan` shows what there is to choose); without them the drive is as like as it can be. With calibrations of
    several patches and an amplifier channel for each, all play at once, and the drives are planned so that a
    drift of the table changes the motion as little as possible; they are as loud as 6 % of error after a
    drift of 1 % allows. With `--quiet-at` other points are kept silent, with `--also` they play a press of
    their own at the same time; the check visits each with the laser.

    Exit codes: 0 the check passed, 1 it failed, 4 the plays do not tell (the file is written and states why).
    """
    loudness = haploop.calibration.Loudness(
        error, level, None if drift is None else haploop.calibration.Drift.usual(drift)
    )
    loaded, press = asked.load_calibrations(), asked.load_press()
    there = elsewhere.load_wanted(asked.average)
    loaded = elsewhere.load_calibrations(loaded, there)
    with (
        reserved(out, size=sizes.of_button(iterations, len(there))),
        rig.opened() as opened,
        Steps() as steps,
    ):
        made = haploop.build_button(
            opened,
            press,
            loaded,
            method=method,
            trade=haploop.calibration.trade_for(press, loaded, opened, loudness, method, there),
            elsewhere=there,
            iterations=iterations,
            progress=steps,
        )
        made.save(out)
    show.print_made(contents.file_contents(out), out, as_json)
    return EXITS[made.verdict]


@button.command()
@on_press
@click.option("--out", "-o", type=NEW, metavar="PLAN.h5", help="Plan file to write, for a report.")
@on_elsewhere
@on_rig()
@showing
def plan(asked: AskedPress, elsewhere: AskedElsewhere, out: Path | None, rig: ChosenRig, shown: Shown) -> int:
    """Show what error buys which loudness, without playing anything.

    PRESS as of `haploop button make`. Within the limits of the rig, a louder button is less like the recorded
    one: the table has both for each method, and whether a person feels it who presses. With `--quiet-at` and
    `--also` it is that of the worst of all points.
    """
    loaded, press = asked.load_calibrations(), asked.load_press()
    there = elsewhere.load_wanted(asked.average)
    loaded = elsewhere.load_calibrations(loaded, there)
    with rig.opened() as opened, Steps() as steps:
        planned = haploop.calibration.plan_button(press, loaded, opened, progress=steps, elsewhere=there)
    if out is not None:
        planned.save(out)
    shown.print(contents.plan_contents(planned))
    return 0


@button.command()
@click.argument("file", type=PATH)
@click.option(
    "--calibration",
    "-c",
    "calibrations",
    type=PATH,
    multiple=True,
    required=True,
    metavar="FINGER.h5",
    help="Calibration under the finger, of `haploop calibrate-finger`; one of each patch.",
)
@click.option("--out", "-o", type=NEW, required=True, metavar="NEW.h5", help="Digital button file to write.")
@PLAYS
@on_rig()
@JSON
def under(
    file: Path, calibrations: Sequence[Path], out: Path, plays: int, rig: ChosenRig, as_json: bool
) -> int:
    """Give a digital button drives for one person's finger.

    FILE stays as it is; NEW.h5 holds three drives more, for a light, a nominal and a firm finger, each
    checked while the finger rests on the point with that force.

    Exit codes: 0 all checks passed, 1 one failed, 4 none failed and one does not tell (the file is written
    and states why).
    """
    loaded = haploop.DigitalButton.load(file)
    fingers = haploop.load_calibrations(calibrations)
    with (
        reserved(out, size=2 * sizes.BUTTON + 3 * plays * sizes.PLAY),
        rig.opened() as opened,
        Steps() as steps,
    ):
        made = haploop.calibration.button_under_finger(opened, loaded, fingers, plays=plays, progress=steps)
        made.save(out)
    show.print_made(contents.file_contents(out), out, as_json)
    return EXITS[made.verdict]


@button.command()
@click.argument("file", type=PATH)
@click.option(
    "--out",
    "-o",
    type=NEW,
    metavar="CHECK.h5",
    help="Check file to write.  [default: dated, in the folder checks]",
)
@on_plays
@on_rig()
@JSON
def check(file: Path, out: Path | None, played: AskedPlays, rig: ChosenRig, as_json: bool) -> int:
    """Play a digital button, measure it, and compare.

    The rig must be the one that FILE was made on. FILE is not changed; every play is kept in a check's file.
    With --finger, a fingertip rests on the point meanwhile, and of the drives that `haploop button under`
    made the one is played that its force calls for: the force sensor's, where one carries the table, or else
    the nominal one.

    Exit codes: 0 the check passed, 1 it failed, 4 the plays do not tell.
    """
    loaded = haploop.DigitalButton.load(file)
    resting = None
    if played.finger is not None:
        nominal = loaded.pressed.nominal if loaded.pressed else 1.0
        resting = RestFinger(played.finger, loaded.drive.point, played.force or nominal)
    out = out or outputs.dated_check(file.stem)
    with reserved(out, size=sizes.of_check(played.plays)), rig.opened() as opened, Steps() as steps:
        result = haploop.play_button(opened, loaded, finger=resting, plays=played.plays, progress=steps)
        result.save(out)
    show.print_made(contents.check_contents(result, loaded.press, out), out, as_json)
    return EXITS[result.verdict]
