"""`haploop calibrate`, `check`: calibrate the table, and play a press on it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..calibration import sizes
from ..instruments.files import reserved
from ..reports import contents, outputs, show
from ..terminal.progress import Steps
from . import front as haploop
from .options import (
    AVERAGE,
    CALIBRATION,
    JSON,
    NEW,
    PATCHES,
    PATH,
    PLAYS,
    PRESSES,
    ChosenRig,
    Names,
    on_rig,
    on_table,
)

if TYPE_CHECKING:
    from ..acquisition import AverageMethod

__all__ = ["calibrate", "check"]


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
@on_rig()
@JSON
def calibrate(
    patches: Sequence[str], point: str, out: Path, waveforms: bool, rig: ChosenRig, as_json: bool
) -> int:
    """Measure the table's response and fit a model."""
    made = [out] if len(patches) == 1 else [haploop.calibration_of(out, patch) for patch in patches]
    measured = [haploop.Waveforms.beside(path) for path in made]
    files = (*made, *measured) if waveforms else tuple(made)
    for path in files:
        outputs.check_new_file(path)
    with (
        reserved(*files, size=len(made) * (sizes.CALIBRATION + waveforms * sizes.WAVEFORMS)),
        rig.opened() as opened,
        Steps() as steps,
    ):
        on_table(opened, point)
        for patch, path, beside in zip(patches, made, measured, strict=True):
            calibration, kept = haploop.calibrate_keeping(opened, patch, point, steps)
            calibration.save(path)
            if waveforms:
                kept.save(beside)
    if len(made) == 1:
        found = contents.file_contents(out)
    else:
        found = contents.calibrations_contents(haploop.load_calibrations(made))
    show.print_contents(found, as_json)
    return 0


@click.command()
@PRESSES
@CALIBRATION
@PATCHES
@click.option(
    "--out",
    "-o",
    type=PATH,
    metavar="DIR",
    help="Folder for press, drive, check and a plot.  [default: only the check, dated, in checks]",
)
@PLAYS
@AVERAGE
@on_rig()
@JSON
def check(
    presses: Sequence[Path],
    calibrations: Sequence[Path],
    patches: Sequence[str] | None,
    out: Path | None,
    plays: int,
    average: AverageMethod,
    rig: ChosenRig,
    as_json: bool,
) -> int:
    """Play a recorded press on the table and compare.

    PRESS is a recording (or several), or the file of a representative press (`haploop represent`, `haploop
    import`). Computes the representative press and its drive, plays the drive, measures the table, and
    compares the result with the press. Every play is kept in the check's file.

    Exit codes: 0 the check passed, 1 it failed or the plays do not show it.
    """
    loaded = haploop.load_calibrations(calibrations, patches or ())
    press = haploop.load_press(presses, average)
    kept = outputs.dated_check(press.button) if out is None else None
    files = (kept,) if kept else outputs.check_files(out or Path(), press.button)
    with (
        reserved(*files, size=sizes.CHECK + plays * sizes.PLAY),
        rig.opened() as opened,
        Steps() as steps,
    ):
        for one in loaded:
            if one.response.simulated != opened.simulated:
                raise haploop.ConfigurationError(
                    f"{calibrations[0]} was measured on a {_kind(one.response.simulated)} table, but the rig "
                    f"{opened.name!r} is {_kind(opened.simulated)}: calibrate that rig first."
                )
        drive = haploop.drive_for(press, loaded, opened.limits)
        result = haploop.check(opened, drive, plays=plays, progress=steps)
        if out is not None:
            outputs.save_check(out, press, result)
        else:
            result.save(files[0])
    show.print_contents(contents.check_contents(result, press, kept), as_json)
    return 0 if result.passed else 1


def _kind(simulated: bool) -> str:
    return "simulated" if simulated else "real"
