"""`haploop calibrations`: a rig's calibration history, and the active calibration."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.commands.options import JSON, PATH, RIG

if TYPE_CHECKING:
    from haploop.calibration.upkeep import History

__all__ = ["CALIBRATIONS", "actor", "calibrations", "history_of"]

CALIBRATIONS = click.option(
    "--calibrations",
    type=PATH,
    metavar="DIR",
    help="Folder of the calibration history.  [default: RIG-calibrations, beside the rig file]",
)
REASON = click.option("--reason", required=True, help="Reason; stored in the history.")


def history_of(rig: str, folder: Path | None) -> History:
    """The history of a rig: in `folder`, beside the rig file, or in this folder for a shipped rig."""
    from haploop.calibration.upkeep import History  # noqa: PLC0415

    path = Path(rig)
    beside = path.parent if path.is_file() else Path()
    return History(folder or beside / f"{path.stem}-calibrations")


def actor() -> str:
    """The user, host and command, for the history."""
    from haploop.instruments.safety import who  # noqa: PLC0415

    person = who()
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
    from haploop.calibration.drive import DigitalButton  # noqa: PLC0415
    from haploop.calibration.upkeep import recalibration  # noqa: PLC0415

    history = history_of(rig, calibrations)
    loaded = [DigitalButton.load(path) for path in buttons]
    note = _audit(rig, {(b.calibration.response.rig, b.simulated) for b in loaded})
    note("adopted", buttons=[str(path) for path in buttons], reason=reason)
    generation = recalibration.adopt(history, loaded, actor=actor(), reason=reason)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command(name="list")
@CALIBRATIONS
@RIG
@JSON
def listing(calibrations: Path | None, rig: str, as_json: bool) -> int:
    """List all calibrations, and mark the active one."""
    from haploop.progress import print_json, print_table  # noqa: PLC0415
    from haploop.show import history as show_history  # noqa: PLC0415

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
    from haploop.progress import print_json, print_table  # noqa: PLC0415
    from haploop.show import history as show_history  # noqa: PLC0415

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
    """Activate an earlier calibration by its NAME or number. Nothing is played."""
    from haploop.calibration.upkeep import calibrations_of  # noqa: PLC0415
    from haploop.instruments.safety import now_utc  # noqa: PLC0415

    history = history_of(rig, calibrations)
    with history.hold():
        generation = history.find(name)
        generation.verify()
        responses = [c.response for c in calibrations_of(generation)]
        note = _audit(rig, {(response.rig, response.simulated) for response in responses})
        note("activated", calibration=generation.name, reason=reason)
        history.activate(generation, when=now_utc(), actor=actor(), reason=reason)
    _show(history, generation.name, as_json)
    return 0


@calibrations.command()
@click.argument("out", type=PATH, metavar="OUT.png")
@CALIBRATIONS
@RIG
@JSON
def plot(out: Path, calibrations: Path | None, rig: str, as_json: bool) -> int:
    """Plot resonance, damping, gain and coherence over time."""
    from haploop.destinations import check_new_picture  # noqa: PLC0415
    from haploop.progress import print_json, print_line  # noqa: PLC0415
    from haploop.show import history as show_history  # noqa: PLC0415
    from haploop.show import show  # noqa: PLC0415

    check_new_picture(out)
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
    """The audit log of the rig. Raises ConfigurationError for calibrations made on another rig."""
    from haploop.instruments import ConfigurationError, load_rig_file  # noqa: PLC0415
    from haploop.instruments.safety import Audit, state_folder  # noqa: PLC0415

    file = load_rig_file(rig)
    others = [name for name, _ in made_on if name != file.name]
    if others:
        raise ConfigurationError(
            f"The calibration was made on the rig {others[0]!r}, not on {file.name!r}: use that rig's --rig."
        )
    simulated = any(simulated for _, simulated in made_on)
    return Audit(file, state_folder(file, simulated), simulated).note


def _show(history: History, name: str, as_json: bool) -> None:
    from haploop.progress import print_json, print_line, print_table  # noqa: PLC0415
    from haploop.show import history as show_history  # noqa: PLC0415

    values, table = show_history.describe(history, history.find(name))
    if as_json:
        print_json(values)
        return
    print_table(table)
    if values["simulated"]:
        print_line("Simulated: no real instrument measured this.")
