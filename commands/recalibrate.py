"""`haploop recalibrate`: verify the active calibration, and renew it if the table has drifted."""

from __future__ import annotations

from pathlib import Path

import click

from ..reports import contents, show
from ..terminal.progress import Steps
from . import front as haploop
from .calibrations import CALIBRATIONS, actor, history_of
from .options import JSON, ChosenRig, on_rig, on_table

__all__ = ["recalibrate"]

_EXITS = {"unchanged": 0, "restored": 0, "drifted": 1, "broken": 3}


@click.command()
@click.option(
    "--laser-at",
    default="button",
    show_default=True,
    metavar="POINT",
    help="Point that the laser is aimed at: button, or a grid point's number.",
)
@click.option("--attended", is_flag=True, help="An operator is present: ask to aim the laser at each point.")
@CALIBRATIONS
@on_rig()
@JSON
def recalibrate(
    laser_at: str, attended: bool, calibrations: Path | None, rig: ChosenRig, as_json: bool
) -> int:
    """Verify the active calibration; renew it after a drift.

    Runs unattended, without prompts, for cron or the Windows Task Scheduler (docs/how-to/unattended.md).

    Exit codes: 0 unchanged, or renewed with every button within tolerance; 1 drifted and not renewed;
    2 invalid request, file or configuration; 3 something is broken. After 1, 2 and 3 the active
    calibration is unchanged.
    """
    history = history_of(rig.name, calibrations)
    history.active()
    with rig.opened() as opened, Steps() as steps:
        on_table(opened, laser_at)
        nobody = None if attended else haploop.Unattended(laser_at)
        if nobody:
            opened.adopt("operator", nobody)
        outcome = haploop.recalibrate(opened, history, actor=actor(), progress=steps)
    written = haploop.write_recalibration(history, outcome)
    assumed = tuple(nobody.assumed) if nobody else ()
    show.print_contents(contents.outcome_contents(history, outcome, assumed, written), as_json)
    return _EXITS[outcome.kind]
