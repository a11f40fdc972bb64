"""`haploop recalibrate`: is the active calibration still true, and if not, can it be brought back?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.commands.calibrations import CALIBRATIONS, history_of, who
from haploop.commands.options import JSON, RIG, SIMULATE, alone, on_table, opened_rig
from haploop.exits import Session

if TYPE_CHECKING:
    from instruments.driver import Mode

__all__ = ["recalibrate"]

_EXITS = {"unchanged": 0, "restored": 0, "drifted": 1, "broken": 3}


@click.command()
@click.option(
    "--laser-at",
    default="button",
    show_default=True,
    metavar="POINT",
    help="Where whoever left the rig left the laser aimed: button, or a grid point's number.",
)
@click.option("--attended", is_flag=True, help="Somebody is there: ask them to aim the laser at each point.")
@CALIBRATIONS
@RIG
@SIMULATE
@JSON
@click.pass_obj
def recalibrate(
    session: Session,
    laser_at: str,
    attended: bool,
    calibrations: Path | None,
    rig: str,
    simulate: Mode | None,
    as_json: bool,
) -> int:
    """Look whether the active calibration still holds; bring every button back if the table has drifted.

    Nothing is asked and nothing waits: made for cron and the Windows Task Scheduler (docs/unattended.md).

    Exit codes: 0 unchanged, or every button is within tolerance again; 1 drifted and not brought back;
    2 wrong request; 3 something is broken. After 1, 2 and 3 the active calibration is what it was.
    """
    from calibration import recalibration  # noqa: PLC0415
    from haploop import recalibration_report as report  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415
    from instruments.unattended import Unattended  # noqa: PLC0415

    history = history_of(rig, calibrations)
    history.active()
    with (
        alone(rig, simulate) as file,
        opened_rig(session, file, simulate) as opened,
        Steps() as steps,
    ):
        on_table(opened, laser_at)
        nobody = None if attended else Unattended(laser_at)
        if nobody:
            opened.adopt("operator", nobody)
        outcome = recalibration.recalibrate(opened, history, who=who(), progress=steps)
    written = report.write(history, outcome)
    report.tell(outcome, tuple(nobody.assumed) if nobody else (), written, as_json)
    return _EXITS[outcome.kind]
