"""The command line. Each family of commands has a file in `haploop.commands`.

`haploop.exits` defines how commands end. Heavy imports are deferred until a command needs them, so that
`haploop --help` is fast.
"""

from __future__ import annotations

import sys

import click

from haploop.commands.analyse import analyse
from haploop.commands.button import button
from haploop.commands.calibrations import calibrations
from haploop.commands.demo import demo
from haploop.commands.examples import show_examples
from haploop.commands.experiment import experiment
from haploop.commands.export import export, import_
from haploop.commands.files import recover, show, verify
from haploop.commands.list_files import list_command
from haploop.commands.live import live
from haploop.commands.maintenance import doctor, log, reset, schema
from haploop.commands.map import map_command
from haploop.commands.recalibrate import recalibrate
from haploop.commands.record import record
from haploop.commands.report import report
from haploop.commands.represent import represent
from haploop.commands.serve import serve
from haploop.commands.study import study
from haploop.commands.table import calibrate, check
from haploop.commands.twin import twin
from haploop.exits import Commands, usable_streams

__all__ = ["cli", "main"]


@click.group(cls=Commands, no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="haploop", message="haploop %(version)s")
def cli() -> None:
    """Measure physical buttons and reproduce them as verified digital ones.

    Exit codes: 0 done and passed, 1 result out of tolerance, 2 invalid request, file or configuration,
    3 instrument failure.
    """


for command in (
    demo,
    record,
    study,
    represent,
    recover,
    verify,
    show,
    report,
    list_command,
    calibrate,
    check,
    map_command,
    button,
    experiment,
    analyse,
    recalibrate,
    calibrations,
    export,
    import_,
    live,
    serve,
    doctor,
    log,
    reset,
    schema,
    twin,
):
    cli.add_command(command)
show_examples(cli)


def main() -> None:
    """The `haploop` command."""
    usable_streams()
    for stream in (sys.stdout, sys.stderr):
        # A console or pipe that cannot encode a character gets a replacement, not an error.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    cli()
