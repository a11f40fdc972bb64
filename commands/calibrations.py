"""`haploop calibrations`, `recalibrate`: a rig's calibration history, and the active calibration."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from .. import instruments
from ..base.errors import InstrumentError
from ..reports import contents, outputs
from ..reports import show as display
from ..terminal.progress import Steps, print_either
from . import public as haploop
from .option_groups import COLUMNS
from .options import JSON, PATH, PICTURE, RIG, TAPE, ChosenRig, on_rig, on_table

if TYPE_CHECKING:
    from ..calibration import Drive, History

CALIBRATIONS = click.option(
    "--calibrations",
    type=PATH,
    metavar="DIR",
    help="Folder of the history.  [default: RIG-calibrations, beside the rig file]",
)
REASON = click.option("--reason", required=True, help="Reason; stored in the history.")
_EXITS = {"unchanged": 0, "restored": 0, "drifted": 1, "touched": 1, "broken": 3, "not shown": 4}


def _history(rig: str, folder: Path | None) -> History:
    """The history in `folder`, or else the rig's own."""
    return haploop.History(folder) if folder else haploop.History.of_rig(rig)


def active_drives(rig: str) -> dict[str, Drive]:
    """The drives of a rig's active digital buttons, by name; none where there is no history to be read."""
    try:
        active = _history(rig, None).active()
        from ..calibration.recalibration import buttons_of  # noqa: PLC0415

        buttons = buttons_of(active)
    except haploop.HaploopError:
        return {}
    return {name: button.drive for name, button in buttons.items()}


def _actor() -> str:
    """The user, host and command, for the history."""
    person = instruments.who()
    return f"{person['user']} on {person['host']}, by {click.get_current_context().command_path}"


@click.group(no_args_is_help=True)
def calibrations() -> None:
    """List, compare and activate calibrations."""


@calibrations.command()
@click.argument("buttons", nargs=-1, required=True, type=PATH, metavar="BUTTON.h5...")
@REASON
@CALIBRATIONS
@RIG
@JSON
def adopt(buttons: Sequence[Path], reason: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Add verified digital buttons to the history, and activate them.

    The new active calibration holds these BUTTONs and the buttons that are active already. A BUTTON
    replaces the active one with the same name, patch and point. The first adoption creates the history.
    """
    history = _history(rig, calibrations)
    loaded = [haploop.DigitalButton.load(path) for path in buttons]
    file = haploop.load_rig_file(rig)
    generation = haploop.calibration.adopt(history, loaded, actor=_actor(), reason=reason, rig=file)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command(name="list")
@CALIBRATIONS
@RIG
@JSON
def listing(calibrations: Path | None, rig: str, as_json: bool) -> int:
    """List all calibrations, and mark the active one."""
    display.print_contents(contents.history_contents(_history(rig, calibrations)), as_json)
    return 0


@calibrations.command()
@click.argument("name", default="active")
@CALIBRATIONS
@RIG
@JSON
def show(name: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Show a calibration by its NAME or number, and verify its files."""
    _show(_history(rig, calibrations), name, as_json)
    return 0


@calibrations.command()
@click.argument("one")
@click.argument("other", default="active")
@CALIBRATIONS
@RIG
@JSON
def diff(one: str, other: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Show what changed from calibration ONE to OTHER."""
    history = _history(rig, calibrations)
    display.print_contents(contents.difference_contents(history.find(one), history.find(other)), as_json)
    return 0


@calibrations.command()
@click.argument("name")
@REASON
@CALIBRATIONS
@RIG
@JSON
def activate(name: str, reason: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Activate an earlier calibration by its NAME or number. Nothing is played."""
    history = _history(rig, calibrations)
    file = haploop.load_rig_file(rig)
    generation = haploop.calibration.activate(history, name, actor=_actor(), reason=reason, rig=file)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command()
@click.argument("out", type=PICTURE, metavar="OUT.png")
@COLUMNS
@CALIBRATIONS
@RIG
@JSON
def plot(out: Path, columns: Literal[1, 2], calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Plot resonance, damping, gain and coherence over time.

    OUT ends with .png, .pdf, .svg, or .csv for its numbers.
    """
    history = _history(rig, calibrations)
    figure = haploop.reports.trend(history, columns)
    simulated = contents.simulated(history)
    outputs.save_picture(figure, out, simulated)
    values = {"plot": str(out), "simulated": simulated, "looks": len(history.looks)}
    print_either(as_json, values, f"Plot: {out}")
    return 0


def _show(history: History, name: str, as_json: bool) -> None:
    display.print_contents(contents.generation_contents(history, history.find(name)), as_json)


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
    2 invalid request, file or configuration; 3 something is broken; 4 whether a button is right cannot be
    told. After 1 to 4 the active calibration is unchanged.
    """
    file = rig.load()  # an error in the rig file is told before that it has no calibration
    history = _history(rig.name or str(rig.simulate).removeprefix(TAPE), calibrations)
    history.active()
    from ..calibration.recalibration import note_unopened  # noqa: PLC0415

    nobody = None if attended else haploop.instruments.Unattended(laser_at)
    with ExitStack() as stack:
        try:
            opened = stack.enter_context(rig.opened())
        except InstrumentError as error:
            outcome = note_unopened(history, error, file.name, bool(rig.simulate or file.simulate))
        else:
            on_table(opened, laser_at)
            if nobody:
                opened.adopt("operator", nobody)
            steps = stack.enter_context(Steps())
            outcome = haploop.recalibrate(opened, history, actor=_actor(), progress=steps)
    written = haploop.reports.write_recalibration(history, outcome)
    assumed = tuple(nobody.assumed) if nobody else ()
    display.print_contents(contents.outcome_contents(history, outcome, assumed, written), as_json)
    return _EXITS[outcome.kind]
