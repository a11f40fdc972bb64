"""What commands share: options, and the contexts that hold and open a rig."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haploop.exits import Session

if TYPE_CHECKING:
    from instruments import Rig, RigFile
    from instruments.driver import Mode

__all__ = ["JSON", "NOTES", "PATH", "RIG", "SIMULATE", "alone", "on_table", "opened_rig"]

RIG = click.option(
    "--rig",
    "-r",
    default="simulated",
    show_default=True,
    metavar="FILE",
    help="Rig file, or the name of a rig that haploop ships.",
)
SIMULATE = click.option(
    "--simulate",
    type=click.Choice(["twin", "wire"]),
    help="Simulate the rig: twins in process, or wires that the real drivers talk to.",
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")
NOTES = click.option("--notes", default="", help="What is to be noted; it is kept in the recording.")
PATH = click.Path(path_type=Path)


def on_table(rig: Rig, point: str) -> None:
    """Refuse a point that the rig's table does not have: ConfigurationError."""
    from instruments import ConfigurationError  # noqa: PLC0415

    points = rig.table.rows * rig.table.columns
    if point != "button" and not (point.isdecimal() and int(point) < points):
        raise ConfigurationError(
            f"{point!r} is no point of the table: it is 'button', or a number from 0 to {points - 1}."
        )


@contextmanager
def alone(rig: str, simulate: Mode | None) -> Iterator[RigFile]:
    """The rig file, and its hardware for this program only: two would switch one relay."""
    from instruments import load_rig_file  # noqa: PLC0415
    from instruments.lock import reserve  # noqa: PLC0415
    from instruments.opening import hardware  # noqa: PLC0415

    file = load_rig_file(rig)
    if simulate or file.simulate:
        yield file
        return
    with reserve(hardware(file, None), f"The rig {file.name!r}"):
        yield file


@contextmanager
def opened_rig(session: Session, file: RigFile, simulate: Mode | None) -> Iterator[Rig]:
    """The rig, opened; says so when it is simulated."""
    from haploop.console import note  # noqa: PLC0415
    from instruments import open_rig  # noqa: PLC0415

    with open_rig(file, simulate=simulate) as opened:
        session.rig_opened = True
        if opened.simulated:
            world = (
                f"{opened.mode}, seed {opened.file.simulation.seed}" if opened.mode else "by its DAQ cards"
            )
            note(f"Everything here is simulated ({world}).")
        yield opened
