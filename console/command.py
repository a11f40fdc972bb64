"""`haploop serve`: the operator's console in a browser."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .. import instruments
from ..commands import public as haploop
from ..commands.calibrations import CALIBRATIONS
from ..commands.options import PATH, RIG, SIMULATE, TAPED
from ..terminal.progress import note

if TYPE_CHECKING:
    from ..instruments.driver import Mode


@click.command()
@RIG
@SIMULATE
@TAPED
@click.option(
    "--data",
    type=PATH,
    default=Path(),
    metavar="DIR",
    help="Folder for recordings, studies, maps and buttons; the pages reach no other file.  [default: this "
    "folder]",
)
@CALIBRATIONS
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=8735,
    show_default=True,
    help="TCP port; 0 selects a free one.",
)
@click.option(
    "--address",
    default="127.0.0.1",
    show_default=True,
    help="Address to listen on. Any other than loopback lets other computers reach the console, without "
    "encryption; each page says so.",
)
@click.option("--stop", is_flag=True, help="Reach the safe state, end the console's worker, and exit.")
@click.option("--virtual-time", is_flag=True, hidden=True)
@click.option("--json", "as_json", is_flag=True, help="Print the address as one JSON object.")
def serve(
    rig: str,
    simulate: Mode | None,
    tape: Path | None,
    data: Path,
    calibrations: Path | None,
    port: int,
    address: str,
    stop: bool,
    virtual_time: bool,
    as_json: bool,
) -> int:
    """Serve the operator's console to a browser here.

    Open the address that is printed; it contains this start's token. The rig is in a process of its own: if
    the server is killed, a recording goes on, and the next `haploop serve` takes it over. Ctrl-C reaches the
    safe state and ends both; where another server shows the same rig, it stops only what was begun on these
    pages.
    """
    if data.exists() and not data.is_dir():
        raise haploop.ConfigurationError(f"--data {data} is a file: name a folder, which may be new.")
    file = haploop.load_rig_file(rig)
    if stop:
        return _stop(file, simulate, as_json)
    try:
        from .data_folder import DataFolder  # noqa: PLC0415
        from .server import Access, serve_console  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise haploop.ConfigurationError(
            f"The console needs {error.name}, which is not installed: python -m pip install 'haploop[ui]'."
        ) from None

    def ready(access: Access) -> None:
        if as_json:
            click.echo(json.dumps({"url": access.url}))
            return
        click.echo(f"Open {access.url}")
        if access.exposed:
            note(access.exposed)
        note("Ctrl-C reaches the safe state and ends the console.")

    if tape is not None:
        instruments.check_recordable(file, simulate or file.simulate)
        _refuse_running(file, simulate)
    kept = calibrations or haploop.History.of_rig(rig, data).folder
    serve_console(rig, file, simulate, DataFolder(data, kept), address, port, ready, virtual_time, tape)
    return 0


def _refuse_running(file: haploop.instruments.RigFile, simulate: Mode | None) -> None:
    """Raise ConfigurationError when the rig's console runs already: its calls are on no tape."""
    from .worker import find_worker  # noqa: PLC0415

    if find_worker(file, simulate) is not None:
        raise haploop.ConfigurationError(
            f"A console of the rig {file.name!r} runs already, and a tape begins with it: end it first with "
            "`haploop serve --stop`."
        )


def _stop(file: haploop.instruments.RigFile, simulate: Mode | None, as_json: bool) -> int:
    from .worker import WorkerHangsError, find_worker  # noqa: PLC0415

    try:
        link = find_worker(file, simulate)
    except WorkerHangsError as hang:
        with suppress(haploop.HaploopError):
            hang.link.stop(deadline=1.0)  # it finds this STOP if it should go on
        raise
    if link is None:
        raise haploop.ConfigurationError(f"No console of the rig {file.name!r} is running.")
    found = link.stop()
    link.end()
    if as_json:
        click.echo(json.dumps(found))
    else:
        note(found["sentence"])
    return 0 if found["state"] == "safe" else 3
