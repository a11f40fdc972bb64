"""`haploop calibrations`: the history of a rig's calibrations, and which of them is active."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.commands.options import JSON, PATH, RIG

if TYPE_CHECKING:
    from calibration.history import History

__all__ = ["CALIBRATIONS", "calibrations", "history_of", "who"]

CALIBRATIONS = click.option(
    "--calibrations",
    type=PATH,
    metavar="DIR",
    help="Folder of the history.  [default: RIG-calibrations, beside the rig file]",
)
REASON = click.option("--reason", required=True, help="Why: it stays in the history.")


def history_of(rig: str, folder: Path | None) -> History:
    """The history of a rig: in `folder`, or beside the rig file, or here for a rig that haploop ships."""
    from calibration.history import History  # noqa: PLC0415

    path = Path(rig)
    beside = path.parent if path.is_file() else Path()
    return History(folder or beside / f"{path.stem}-calibrations")


def who() -> str:
    """Who did it: the command, and the account that it runs in."""
    from instruments.audit import who  # noqa: PLC0415

    person = who()
    return f"{person['user']} on {person['host']}, by {click.get_current_context().command_path}"


@click.group(no_args_is_help=True)
def calibrations() -> None:
    """What was ever calibrated, and which of it is active."""


@calibrations.command()
@click.argument("buttons", nargs=-1, required=True, type=PATH, metavar="BUTTON.h5...")
@REASON
@CALIBRATIONS
@RIG
@JSON
def adopt(buttons: Sequence[Path], reason: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Make verified BUTTONs, with those that are active already, the active calibration.

    A history begins that way, and a button is added or replaced that way.
    """
    from calibration import recalibration  # noqa: PLC0415
    from calibration.button import DigitalButton  # noqa: PLC0415

    history = history_of(rig, calibrations)
    loaded = [DigitalButton.load(path) for path in buttons]
    note = _audit(rig, {(b.calibration.response.rig, b.simulated) for b in loaded})
    note("adopted", buttons=[str(path) for path in buttons], reason=reason)
    generation = recalibration.adopt(history, loaded, who=who(), reason=reason)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command(name="list")
@CALIBRATIONS
@RIG
@JSON
def listing(calibrations: Path | None, rig: str, as_json: bool) -> int:
    """All of them, and which is active."""
    from haploop import show_history  # noqa: PLC0415
    from haploop.console import print_json, print_table  # noqa: PLC0415

    values, table = show_history.listing(history_of(rig, calibrations))
    if as_json:
        print_json(values)
    else:
        print_table(table)
    return 0


@calibrations.command()
@click.argument("name", default="active")
@CALIBRATIONS
@RIG
@JSON
def show(name: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """One of them, by its NAME or number: places, buttons, why it was made. Checks that it is whole."""
    _show(history_of(rig, calibrations), name, as_json)
    return 0


@calibrations.command()
@click.argument("one")
@click.argument("other", default="active")
@CALIBRATIONS
@RIG
@JSON
def diff(one: str, other: str, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """What changed from ONE to OTHER."""
    from haploop import show_history  # noqa: PLC0415
    from haploop.console import print_json, print_table  # noqa: PLC0415

    history = history_of(rig, calibrations)
    values, table = show_history.difference(history.find(one), history.find(other))
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
    """Make an earlier one, by its NAME or number, the active one. Nothing is played."""
    from calibration.recalibration import calibrations_of  # noqa: PLC0415
    from instruments.audit import now_utc  # noqa: PLC0415

    history = history_of(rig, calibrations)
    with history.hold():
        generation = history.find(name)
        generation.verify()
        responses = [c.response for c in calibrations_of(generation)]
        note = _audit(rig, {(response.rig, response.simulated) for response in responses})
        note("activated", calibration=generation.name, reason=reason)
        history.activate(generation, when=now_utc(), who=who(), reason=reason)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command()
@click.argument("out", type=PATH, metavar="OUT.png")
@CALIBRATIONS
@RIG
@JSON
def plot(out: Path, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Draw resonance, damping, gain and coherence over time."""
    from haploop import show, show_history  # noqa: PLC0415
    from haploop.console import print_json, print_line  # noqa: PLC0415
    from haploop.targets import new_picture  # noqa: PLC0415

    new_picture(out)
    history = history_of(rig, calibrations)
    figure = show_history.trend(history)
    simulated = show_history.simulated(history)
    show.save(figure, out, simulated)
    if as_json:
        print_json({"plot": str(out), "simulated": simulated, "looks": len(history.looks)})
    else:
        print_line(f"Plot: {out}")
    return 0


def _audit(rig: str, made_on: Collection[tuple[str, bool]]) -> Callable[..., None]:
    """The log of a rig, on which all of this was made. Raises ConfigurationError for another's."""
    from instruments import ConfigurationError, load_rig_file  # noqa: PLC0415
    from instruments.audit import Audit, state_folder  # noqa: PLC0415

    file = load_rig_file(rig)
    others = [name for name, _ in made_on if name != file.name]
    if others:
        raise ConfigurationError(
            f"This was made on the rig {others[0]!r}, not on {file.name!r}: name its --rig."
        )
    simulated = any(simulated for _, simulated in made_on)
    return Audit(file, state_folder(file, simulated), simulated).note


def _show(history: History, name: str, as_json: bool) -> None:
    from haploop import show_history  # noqa: PLC0415
    from haploop.console import print_json, print_line, print_table  # noqa: PLC0415

    values, table = show_history.describe(history, history.find(name))
    if as_json:
        print_json(values)
        return
    print_table(table)
    if values["simulated"]:
        print_line("Simulated: no real instrument measured this.")
