"""`haploop calibrate`, `calibrate-finger`, `check`: calibrate the table, and play a press on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from ..base.errors import DataError
from ..base.files import reserved
from ..calibration import sizes
from ..calibration.band import BAND
from ..reports import contents, outputs, show
from ..terminal.progress import Steps, note
from . import public as haploop
from .option_groups import AskedPlays, AskedPress, on_plays, on_press
from .options import EXITS, FORCE, JSON, NEW, PATH, ChosenRig, FiniteRange, Names, on_rig, on_table

_FEWEST = 3
"""Changes from which `with_scatter` tells a scatter."""


@click.command()
@click.option(
    "--patch",
    "--patches",
    "patches",
    type=Names(),
    default="A",
    show_default=True,
    metavar="LIST",
    help="Patch to excite. Of several, for example A,B,C,D, each has its own file: FILE-A.h5, FILE-B.h5 and "
    "so on.",
)
@click.option(
    "--point",
    default="button",
    show_default=True,
    help="Point that the laser is aimed at: button, or a grid point's number.",
)
@click.option(
    "--out",
    "-o",
    type=NEW,
    default=Path("calibration.h5"),
    show_default=True,
    metavar="FILE.h5",
    help="Calibration file to write.",
)
@click.option(
    "--waveforms/--no-waveforms",
    default=True,
    show_default=True,
    help="Keep what was measured in FILE-waveforms.h5 (0.13 MB for each second).",
)
@click.option(
    "--since",
    multiple=True,
    type=PATH,
    metavar="FILE.h5",
    help="Earlier calibration of the same patches, named as with --out; may be repeated. Tells how channels' "
    "gains and delays scatter, which drives of several patches are planned against.",
)
@click.option(
    "--carrier",
    type=FiniteRange(*BAND, min_open=True, max_open=True),
    metavar="HZ",
    help="Frequency that carries presses.  [default: the strongest resonance in the band of drives]",
)
@on_rig()
@JSON
def calibrate(
    patches: Sequence[str],
    point: str,
    out: Path,
    waveforms: bool,
    since: Sequence[Path],
    carrier: float | None,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Measure the table's response and fit a model.

    Exit codes: 0 calibrated, 1 calibrated, and --since tells nothing of the channels.
    """
    made = (
        [out] if len(patches) == 1 else [haploop.calibration.calibration_of(out, patch) for patch in patches]
    )
    measured = [haploop.calibration.Waveforms.beside(path) for path in made]
    files = (*made, *measured) if waveforms else tuple(made)
    earlier = [one for path in dict.fromkeys(since) for one in haploop.load_calibrations([path], patches)]
    if since and len([one for one in earlier if one.response.point == point]) < _FEWEST:
        raise click.UsageError(
            f"--since needs {_FEWEST} earlier calibrations of these patches at the {point} point, one of "
            "each of three patches or more of one: fewer tell no scatter."
        )
    for path in files:
        outputs.check_new_file(path)
    with (
        reserved(*files, size=len(made) * (sizes.CALIBRATION + waveforms * sizes.WAVEFORMS)),
        rig.opened() as opened,
        Steps() as steps,
    ):
        on_table(opened, point)
        found = [haploop.calibration.calibrate_keeping(opened, patch, point, steps) for patch in patches]
        stated, unsaid = [calibration for calibration, _ in found], ""
        if carrier is not None:
            stated = [one.carried_by(carrier) for one in stated]
        if earlier:
            try:
                stated = haploop.calibration.with_scatter(stated, earlier)
            except DataError as error:
                unsaid = f"{error} The estimates of it stay."
        for calibration, (_, kept), path, kept_in in zip(stated, found, made, measured, strict=True):
            calibration.save(path)
            if waveforms:
                replace(kept, calibration=calibration.digest).save(kept_in)
    if unsaid:
        note(unsaid)
    if len(made) == 1:
        shown = contents.file_contents(out)
    else:
        shown = contents.calibrations_contents(haploop.load_calibrations(made))
    show.print_contents(shown, as_json)
    return 1 if unsaid else 0


@click.command("calibrate-finger")
@click.argument("bare", type=PATH, metavar="BARE.h5")
@click.option(
    "--participant", "-p", required=True, metavar="NAME", help="Whose fingertip rests on the point: P01."
)
@FORCE
@click.option("--out", "-o", type=NEW, required=True, metavar="FILE.h5", help="Calibration file to write.")
@click.option(
    "--beside",
    type=Names(),
    metavar="LIST",
    help="Grid points that the laser looks at, where it does not see the one under the finger.",
)
@click.option(
    "--map",
    "mapped",
    type=PATH,
    metavar="DIR",
    help="Map of the table, whose modes tell what the finger does at its own point; without --beside the "
    "laser looks at the four grid points next to it.",
)
@on_rig()
@JSON
def calibrate_finger(
    bare: Path,
    participant: str,
    force: float | None,
    out: Path,
    beside: Sequence[str] | None,
    mapped: Path | None,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Measure what a resting fingertip does to a calibration.

    BARE.h5 is the calibration of the bare table. When asked, the participant rests a
    fingertip on its point with the force, and holds still for a few seconds.
    """
    loaded = haploop.Calibration.load(bare)
    plate = haploop.calibration.VibrationMap.load(mapped).plate_modes() if mapped else None
    looked = tuple(beside or ())
    outputs.check_new_file(out)
    with reserved(out, size=sizes.CALIBRATION), rig.opened() as opened, Steps() as steps:
        for point in looked or (loaded.response.point,):
            on_table(opened, point)
        haploop.calibration.calibrate_finger(
            opened, loaded, participant, force=force or 1.0, beside=looked, plate=plate, progress=steps
        ).save(out)
    show.print_contents(contents.file_contents(out), as_json)
    return 0


@click.command()
@on_press
@click.option(
    "--out",
    "-o",
    type=PATH,
    metavar="DIR",
    help="Folder for press, drive, check and a plot.  [default: only the check, dated, in checks]",
)
@on_plays
@on_rig()
@JSON
def check(asked: AskedPress, out: Path | None, played: AskedPlays, rig: ChosenRig, as_json: bool) -> int:
    """Play a recorded press on the table and compare.

    PRESS is a recording (or several), or the file of a representative press (`haploop represent`, `haploop
    import`). Computes the representative press and its drive, plays the drive, measures the table, and
    compares the result with the press. Every play is kept in the check's file. With --finger, a fingertip
    rests on the point meanwhile, and the verdict is of the motion under it; the laser has to see the point
    from the other side of the pane. With a calibration under a finger, and a force sensor that carries the
    table, drives are made for a light, a nominal and a firm finger, and the one is played that the force
    calls for.

    Exit codes: 0 the check passed, 1 it failed, 4 the plays do not tell.
    """
    loaded = asked.load_calibrations()
    held = next((one.finger for one in loaded if one.finger), None)
    if held is not None and played.finger is None:
        raise haploop.ConfigurationError(
            f"{asked.calibrations[0]} holds under {held.participant}'s finger, and a check of the bare table "
            f"says nothing about it: check with --finger {held.participant}."
        )
    press = asked.load_press()
    kept = outputs.dated_check(press.button) if out is None else None
    files = (kept,) if kept else outputs.check_files(out or Path(), press.button)
    with reserved(*files, size=sizes.of_check(played.plays)), rig.opened() as opened, Steps() as steps:
        for one in loaded:
            if one.response.simulated != opened.simulated:
                raise haploop.ConfigurationError(
                    f"{asked.calibrations[0]} was measured on a {_kind(one.response.simulated)} table, but "
                    f"the rig {opened.name!r} is {_kind(opened.simulated)}: calibrate that rig first."
                )
        if played.finger is None:
            drive = haploop.drive_for(press, loaded, opened.limits)
            result = haploop.check(opened, drive, plays=played.plays, progress=steps)
        else:
            by_force = held is not None and opened.table.force
            result = haploop.calibration.check_under_finger(
                opened,
                (haploop.calibration.pressed_drives if by_force else haploop.drive_for)(
                    press, loaded, opened.limits
                ),
                played.finger,
                force=played.force or (held.force if held else 1.0),
                plays=played.plays,
                made_for=None if by_force else held,
                progress=steps,
            )
        if out is not None:
            outputs.save_check(out, press, result)
        else:
            result.save(files[0])
    show.print_contents(contents.check_contents(result, press, kept), as_json)
    return EXITS[result.verdict]


def _kind(simulated: bool) -> str:
    return "simulated" if simulated else "real"
