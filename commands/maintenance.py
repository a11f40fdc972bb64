"""Maintenance of a rig: `haploop doctor`, `log`, `reset` and `schema`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from ..reports import contents, show
from ..terminal.progress import Steps, note, print_json
from . import front as haploop
from .calibrations import active_drives
from .options import JSON, ChosenRig, FiniteRange, on_rig

if TYPE_CHECKING:
    from ..calibration import Finding


@click.command()
@click.option(
    "--mass",
    type=FiniteRange(0.05, 10),
    default=0.5,
    show_default=True,
    metavar="KG",
    help="Known mass for the force sensor test.",
)
@click.option(
    "--loop",
    metavar="CHANNEL",
    help="Measure the DAQ's output by a cable to this channel, and nothing else (sound cards).",
)
@click.option(
    "--volts",
    type=FiniteRange(1e-3, 100),
    metavar="RMS",
    help="With --loop: what a voltmeter at the output showed.",
)
@on_rig()
@JSON
def doctor(mass: float, loop: str | None, volts: float | None, rig: ChosenRig, as_json: bool) -> int:
    """Test all instruments of a rig.

    Checks that each instrument is present, wired and set as the rig file says.

    Exit codes: 0 no finding is red, 1 at least one is red, 3 an instrument cannot be opened.
    """
    if volts is not None and loop is None:
        raise haploop.ConfigurationError("--volts needs --loop: name the channel that the cable leads to.")
    missing, drives = False, active_drives(rig.name or str(rig.simulate))
    findings: Sequence[Finding] = ()
    with rig.reserved() as file:
        simulated = (rig.simulate or file.simulate) is not None
        try:
            with rig.open(file) as opened, Steps() as steps:
                simulated = opened.simulated
                if loop is not None:
                    findings = haploop.examine_loop(opened, loop, volts, steps)
                else:
                    findings = haploop.examine(opened, mass, steps, drives)
        except haploop.HaploopError as error:
            # Once the rig has opened, the only error here is an unconfirmed safe state: report that one.
            if rig.state.rig_opened:
                if findings:
                    show.print_contents(contents.findings_contents(findings, file.name, simulated), as_json)
                raise
            findings, missing = haploop.examine_each(file, rig.simulate, error), True
    show.print_contents(contents.findings_contents(findings, file.name, simulated), as_json)
    if missing:
        return 3
    return int(any(finding.status == "red" for finding in findings))


@click.command()
@click.option(
    "--last", type=click.IntRange(1), default=20, show_default=True, help="Number of entries to show."
)
@on_rig(opens=False)
@JSON
def log(last: int, rig: ChosenRig, as_json: bool) -> None:
    """Show the audit log of a rig.

    Lists what was connected, played, refused and stopped, when, by whom and with which rig file.
    """
    file = rig.load()
    found = contents.log_contents(file, rig.simulate or file.simulate, last)
    show.print_contents(found, as_json)


@click.command()
@click.option(
    "--reason", required=True, help="Cause of the trip and what was done about it; stored in the audit log."
)
@on_rig(opens=False)
def reset(reason: str, rig: ChosenRig) -> None:
    """Clear the lockout after a limit trip.

    Do so once someone has inspected the rig: it plays again.
    """
    file = rig.load()
    haploop.reset_lockout(file, reason, rig.simulate)
    note(f"The rig {file.name} plays again.")


@click.command()
def schema() -> None:
    """Print the JSON schema of rig files, for use in editors."""
    print_json(haploop.rig_schema())
