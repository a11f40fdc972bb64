"""`haploop doctor`, `log`, `reset`, `schema`: is the rig as its file says, and what has it done?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from haploop.commands.options import JSON, RIG, SIMULATE, alone, opened_rig
from haploop.exits import Session
from instruments import HaploopError

if TYPE_CHECKING:
    from instruments.driver import Mode

__all__ = ["doctor", "log", "reset", "schema"]


@click.command()
@click.option(
    "--mass",
    type=click.FloatRange(0.05, 10),
    default=0.5,
    show_default=True,
    metavar="KG",
    help="Known mass, to be put on the force sensor when asked.",
)
@RIG
@SIMULATE
@JSON
@click.pass_obj
def doctor(session: Session, mass: float, rig: str, simulate: Mode | None, as_json: bool) -> int:
    """Look at each instrument of a rig: is it there, wired and set as the rig file says?

    Exit codes: 0 nothing is red, 1 something is, 3 an instrument cannot be opened.
    """
    from haploop import doctor as diagnosis  # noqa: PLC0415
    from haploop.console import Steps  # noqa: PLC0415

    missing = False
    with alone(rig, simulate) as file:
        simulated = (simulate or file.simulate) is not None
        try:
            with opened_rig(session, file, simulate) as opened, Steps() as steps:
                simulated = opened.simulated
                findings = diagnosis.examine(opened, mass, steps)
        except HaploopError as error:
            # Once it is open, only a safe state that was not reached comes here: that is the message.
            if session.rig_opened:
                raise
            findings, missing = diagnosis.find_each(file, simulate, error), True
    diagnosis.tell(findings, file.name, simulated, as_json)
    if missing:
        return 3
    return int(any(finding.status == "red" for finding in findings))


@click.command()
@click.option("--last", type=click.IntRange(1), default=20, show_default=True, help="How many entries.")
@RIG
@SIMULATE
@JSON
def log(last: int, rig: str, simulate: Mode | None, as_json: bool) -> None:
    """What a rig has connected, played, refused and stopped, when, by whom and with which rig file."""
    from haploop import logbook  # noqa: PLC0415
    from instruments import load_rig_file  # noqa: PLC0415

    file = load_rig_file(rig)
    logbook.tell(file, simulate or file.simulate, last, as_json)


@click.command()
@click.option("--reason", required=True, help="What stopped the play, and what was done about it.")
@RIG
@SIMULATE
def reset(reason: str, rig: str, simulate: Mode | None) -> None:
    """Let a rig play again that a limit has stopped. For a person, who has looked at it."""
    from haploop import logbook  # noqa: PLC0415

    with alone(rig, simulate) as file:
        logbook.reset(file, simulate or file.simulate, reason)


@click.command()
def schema() -> None:
    """Print the JSON schema of rig files, for editors."""
    from haploop.console import print_json  # noqa: PLC0415
    from instruments.rig_schema import rig_schema  # noqa: PLC0415

    print_json(rig_schema())
