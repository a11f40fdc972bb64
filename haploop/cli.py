"""The command line. Each family of commands has a file in `haploop.commands`.

How a command ends stands in `haploop.exits`. Heavy imports wait until a command needs them, so that
`haploop --help` answers at once.
"""

from __future__ import annotations

import sys

import click

from haploop.commands.button import button
from haploop.commands.calibrations import calibrations
from haploop.commands.care import doctor, log, reset, schema
from haploop.commands.demo import demo
from haploop.commands.export import export, import_
from haploop.commands.files import recover, show, verify
from haploop.commands.map import map_command
from haploop.commands.recalibrate import recalibrate
from haploop.commands.record import record
from haploop.commands.study import study
from haploop.commands.table import calibrate, check
from haploop.exits import Commands
from haploop.serve import twin

__all__ = ["cli", "main"]


@click.group(cls=Commands, no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="haploop", message="haploop %(version)s")
def cli() -> None:
    """From a physical button to a verified digital one.

    Exit codes: 0 done and passed, 1 out of tolerance, 2 wrong request, 3 an instrument failed.
    """


for command in (
    demo,
    record,
    study,
    recover,
    verify,
    show,
    calibrate,
    check,
    map_command,
    button,
    recalibrate,
    calibrations,
    export,
    import_,
    doctor,
    log,
    reset,
    schema,
    twin,
):
    cli.add_command(command)


def main() -> None:
    """The `haploop` command."""
    for stream in (sys.stdout, sys.stderr):
        # A console or a pipe that cannot show a sign gets a replacement, not an error.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    cli()
