"""The command line. Each family of commands has a file in `haploop.commands`, or in the room that owns it.

`haploop.terminal.exits` defines how commands end. Heavy imports are deferred until a command needs them, so
that `haploop --help` is fast.
"""

from __future__ import annotations

import sys

import click

from ..reports import satellites
from ..terminal.exits import Commands, usable_streams
from ..terminal.progress import print_line
from .button import button
from .calibrations import calibrations, recalibrate
from .demo.command import demo
from .examples import show_examples
from .figures import figures
from .files import list_command, recover, report, show, verify
from .live import live
from .map import map_command
from .new import new
from .record import record, represent
from .rig import doctor, log, reset, rig, schema
from .status import status
from .study import study
from .table import calibrate, calibrate_finger, check
from .tape import tape
from .twin import twin

_serve, _experiment, _analyse, _export, _import = (
    satellites.owned(f"command {name}") for name in ("serve", "experiment", "analyse", "export", "import")
)


@click.group(
    "haploop",
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="haploop", message="haploop %(version)s")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Measure physical buttons and reproduce them as verified digital ones.

    Without a command: what is in this folder, and what to do next.

    Exit codes: 0 done and passed, 1 result out of tolerance, 2 invalid request, file or configuration,
    3 instrument failure, 4 the measurement does not tell.
    """
    if ctx.invoked_subcommand is None and not status():
        click.echo(ctx.get_help())
        print_line("\nNothing of haploop is in this folder. Begin with: haploop demo, or haploop new FOLDER.")


cli.sections = {
    "Make a button, in this order": (doctor, record, represent, calibrate, button, show, report, demo),
    "Look": (live, list_command, _serve, check, map_command, calibrate_finger, figures, _export, _import),
    "People": (new, study, _experiment, _analyse),
    "Maintain": (recalibrate, calibrations, verify, recover, log, reset, schema, rig, tape, twin),
}
for commands in cli.sections.values():
    for command in commands:
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
