"""Maintenance of a rig: `haploop doctor`, `log`, `reset` and `schema`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ..reports import show as display
from ..terminal.exits import CommandState
from ..terminal.progress import Steps, note, print_json
from . import front as haploop
from .options import JSON, RIG, SIMULATE, FiniteRange, alone, opened_rig

if TYPE_CHECKING:
    from ..instruments.driver import Mode

__all__ = ["doctor", "log", "reset", "schema"]


@click.command()
@click.option(
    "--mass",
    type=FiniteRange(0.05, 10),
    default=0.5,
    show_default=True,
    metavar="KG",
    help="Known mass for the force sensor test.",
)
@RIG
@SIMULATE
@JSON
@click.pass_obj
def doctor(state: CommandState, mass: float, rig: str, simulate: Mode | None, as_json: bool) -> int:
    """Test all instruments of a rig.

    Checks that each instrument is present, wired and set as the rig file says.

    Exit codes: 0 no finding is red, 1 at least one is red, 3 an instrument cannot be opened.
    """
    missing = False
    with alone(rig, simulate) as file:
        simulated = (simulate or file.simulate) is not None
        try:
            with opened_rig(state, file, simulate) as opened, Steps() as steps:
                simulated = opened.simulated
                findings = haploop.examine(opened, mass, steps)
        except haploop.HaploopError as error:
            # Once the rig has opened, the only error here is an unconfirmed safe state: report that one.
            if state.rig_opened:
                raise
            findings, missing = haploop.examine_each(file, simulate, error), True
    display.show_findings(findings, file.name, simulated, as_json)
    if missing:
        return 3
    return int(any(finding.status == "red" for finding in findings))


@click.command()
@click.option(
    "--last", type=click.IntRange(1), default=20, show_default=True, help="Number of entries to show."
)
@RIG
@SIMULATE
@JSON
def log(last: int, rig: str, simulate: Mode | None, as_json: bool) -> None:
    """Show the audit log of a rig.

    Lists what was connected, played, refused and stopped, when, by whom and with which rig file.
    """
    file = haploop.load_rig_file(rig)
    display.show_log(file, simulate or file.simulate, last, as_json)


@click.command()
@click.option(
    "--reason", required=True, help="Cause of the trip and what was done about it; stored in the audit log."
)
@RIG
@SIMULATE
def reset(reason: str, rig: str, simulate: Mode | None) -> None:
    """Clear the lockout after a limit trip.

    Do so once someone has inspected the rig: it plays again.
    """
    file = haploop.load_rig_file(rig)
    haploop.reset_lockout(file, reason, simulate)
    note(f"The rig {file.name} plays again.")


@click.command()
def schema() -> None:
    """Print the JSON schema of rig files, for use in editors."""
    print_json(haploop.rig_schema())
