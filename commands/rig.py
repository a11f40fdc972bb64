"""`haploop rig`, `doctor`, `log`, `reset`, `schema`: describe a rig in a file, check it, look after it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..reports import contents, show
from ..terminal.progress import Steps, note, print_either, print_json
from . import public as haploop
from .calibrations import active_drives
from .options import JSON, PATH, ChosenRig, FiniteRange, NewFile, on_rig

if TYPE_CHECKING:
    from ..calibration import Finding


@click.group()
def rig() -> None:
    """Describe a rig in a file."""


@rig.command()
@click.argument("file", type=NewFile(".toml"), metavar="FILE.toml")
@click.option("--like", metavar="NAME", default="", help="The shipped rig that yours is like.")
@JSON
def new(file: Path, like: str, as_json: bool) -> int:
    """Write a rig file like a shipped one, for you to edit.

    NI cards, serial ports, VISA resources and sound cards that this computer has are filled in; nothing is
    opened. What has to be looked up is marked, and `haploop rig check` lists it.
    """
    from ..instruments import config, describing  # noqa: PLC0415 - slow to load

    if not like:
        raise haploop.ConfigurationError(
            f"Say which rig yours is like: --like {', '.join(config.shipped_rigs())}."
        )
    made = haploop.instruments.new_rig(file, like, haploop.instruments.look_for_hardware())
    left = len(describing.to_look_up(file))
    print_either(
        as_json,
        {"rig": str(file), "name": made.name, "digest": made.digest, "to_look_up": left},
        f"{file}: the rig {made.name!r}, with {left} lines to look up. Edit it; then: haploop rig check "
        f"{shlex.quote(str(file))}",
    )
    return 0


@rig.command()
@click.argument("file", type=PATH, metavar="FILE.toml")
@JSON
def check(file: Path, as_json: bool) -> int:
    """Check a rig file line by line; nothing is opened.

    Exit codes: 0 it is complete, 1 lines are left to look up, 2 it is not valid.
    """
    from ..instruments import describing  # noqa: PLC0415 - slow to load

    wrong = describing.rig_problems(file)
    left = describing.to_look_up(file)
    if wrong:
        for sentence in wrong[:-1]:
            note(sentence)
        raise haploop.ConfigurationError(wrong[-1])
    said = (
        f"{file} is complete. Try it on twins: haploop doctor --rig {shlex.quote(str(file))} --simulate twin"
    )
    if left:
        mark = describing.LOOK_UP
        said = "\n".join([f"{file} is valid, with examples' values in lines that say {mark}:", *left])
    print_either(as_json, {"rig": str(file), "to_look_up": left}, said)
    return int(bool(left))


# Maintenance of a rig: `haploop doctor`, `log`, `reset` and `schema`.


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
                    findings = haploop.calibration.examine_loop(opened, loop, volts, steps)
                else:
                    findings = haploop.examine(opened, mass, steps, drives)
        except haploop.HaploopError as error:
            # Once the rig has opened, the only error here is an unconfirmed safe state: report that one.
            if rig.state.rig_opened:
                if findings:
                    show.print_contents(contents.findings_contents(findings, file.name, simulated), as_json)
                raise
            findings, missing = haploop.calibration.examine_each(file, rig.simulate, error), True
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
    haploop.instruments.reset_lockout(file, reason, rig.simulate)
    note(f"The rig {file.name} plays again.")


@click.command()
def schema() -> None:
    """Print the JSON schema of rig files, for use in editors."""
    print_json(haploop.instruments.rig_schema())
