"""`haploop calibrations`: a rig's calibration history, and the active calibration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from .. import instruments
from ..reports import outputs
from ..reports import show as display
from ..terminal.progress import SIMULATED, print_json, print_line, print_table
from . import front as haploop
from .options import COLUMNS, JSON, PATH, RIG

if TYPE_CHECKING:
    from ..calibration import History

__all__ = ["CALIBRATIONS", "actor", "calibrations", "history_of"]

CALIBRATIONS = click.option(
    "--calibrations",
    type=PATH,
    metavar="DIR",
    help="Folder of the history.  [default: RIG-calibrations, beside the rig file]",
)
REASON = click.option("--reason", required=True, help="Reason; stored in the history.")


def history_of(rig: str, folder: Path | None) -> History:
    """The history of a rig: in `folder`, beside the rig file, or in this folder for a shipped rig."""
    path = Path(rig)
    beside = path.parent if path.is_file() else Path()
    return haploop.History(folder or beside / f"{path.stem}-calibrations")


def actor() -> str:
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
    history = history_of(rig, calibrations)
    loaded = [haploop.DigitalButton.load(path) for path in buttons]
    file = haploop.load_rig_file(rig)
    generation = haploop.adopt(history, loaded, actor=actor(), reason=reason, rig=file)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command(name="list")
@CALIBRATIONS
@RIG
@JSON
def listing(calibrations: Path | None, rig: str, as_json: bool) -> int:
    """List all calibrations, and mark the active one."""
    history = history_of(rig, calibrations)
    values, table = display.listing(history)
    if as_json:
        print_json(values)
    elif not values["generations"]:
        print_line(f"{history.folder} holds no calibration yet: make one with `haploop calibrations adopt`.")
    else:
        print_table(table)
    return 0


@calibrations.command()
@click.argument("name", default="active")
@CALIBRATIONS
@RIG
@JSON
def show(name: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Show a calibration by its NAME or number, and verify its files."""
    _show(history_of(rig, calibrations), name, as_json)
    return 0


@calibrations.command()
@click.argument("one")
@click.argument("other", default="active")
@CALIBRATIONS
@RIG
@JSON
def diff(one: str, other: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Show what changed from calibration ONE to OTHER."""
    history = history_of(rig, calibrations)
    values, table = display.difference(history.find(one), history.find(other))
    if as_json:
        print_json(values)
    else:
        print_table(table)
    return 0


@calibrations.command()
@click.argument("name")
@REASON
@CALIBRATIONS
@RIG
@JSON
def activate(name: str, reason: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Activate an earlier calibration by its NAME or number. Nothing is played."""
    history = history_of(rig, calibrations)
    file = haploop.load_rig_file(rig)
    generation = haploop.activate(history, name, actor=actor(), reason=reason, rig=file)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command()
@click.argument("out", type=PATH, metavar="OUT.png")
@COLUMNS
@CALIBRATIONS
@RIG
@JSON
def plot(out: Path, columns: Literal[1, 2], calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Plot resonance, damping, gain and coherence over time.

    OUT ends with .png, .pdf or .svg.
    """
    outputs.check_new_picture(out)
    history = history_of(rig, calibrations)
    figure = haploop.trend(history, columns)
    simulated = display.simulated(history)
    outputs.save_picture(figure, out, simulated)
    if as_json:
        print_json({"plot": str(out), "simulated": simulated, "looks": len(history.looks)})
    else:
        print_line(f"Plot: {out}")
    return 0


def _show(history: History, name: str, as_json: bool) -> None:
    values, table = display.describe(history, history.find(name))
    if as_json:
        print_json(values)
        return
    print_table(table)
    if values["simulated"]:
        print_line(SIMULATED)
