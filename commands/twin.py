"""`haploop twin`: serve simulated instruments to other programs."""

from __future__ import annotations

import json
import re
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..base.threads import Flag
from ..terminal.progress import note
from .options import NewFile, tape_session
from .serving import Asked, has_terminals, ports_of, served

if TYPE_CHECKING:
    from ..mocks.plant import Plant

_EVERY = 3.0
"""s: interval between two simulated presses."""

_rig = click.option(
    "--rig",
    "-r",
    default="bench",
    show_default=True,
    metavar="FILE",
    help="Rig file, or the name of a shipped rig, whose instruments are simulated.",
)
_allow = click.option(
    "--allow",
    multiple=True,
    metavar="NAME",
    help="Let a COMMAND open this as it is: a port, a VISA resource, an address of a network, sound. "
    "Can be repeated.",
)
_as_json = click.option("--json", "as_json", is_flag=True, help="Print the addresses as one JSON object.")


@click.group(no_args_is_help=True)
def twin() -> None:
    """Serve simulated instruments to other programs.

    The instruments run in real time and use their own protocols.
    """


@twin.command(short_help="Serve simulated NI-DAQmx devices over gRPC.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=True,
    help="TCP port; 0 selects a free one.",
)
@click.option(
    "--rig",
    "-r",
    metavar="FILE",
    help="Rig file, or the name of a shipped rig, whose devices are simulated.  [default: simulated]",
)
@click.option(
    "--devices",
    type=click.Path(path_type=Path),
    metavar="FILE.ini",
    help="Serve the devices in this NI MAX text export.",
)
@click.option(
    "--device",
    "named",
    multiple=True,
    metavar="NAME=PRODUCT",
    help="Serve this device: --device Dev1=PCIe-6363. Can be repeated.",
)
@click.option(
    "--bench",
    type=click.Path(path_type=Path),
    metavar="FILE.toml",
    help="Set inputs, connect wires, let cards fail and serve other instruments as this file says.",
)
@click.option("--tape", type=NewFile(".tape"), metavar="FILE.tape", help="Record every call to the devices.")
@_allow
@click.argument("command", nargs=-1, type=click.UNPROCESSED)
def ni(
    port: int,
    rig: str | None,
    devices: Path | None,
    named: tuple[str, ...],
    bench: Path | None,
    tape: Path | None,
    allow: tuple[str, ...],
    command: tuple[str, ...],
) -> int | None:
    """Serve simulated NI-DAQmx devices over gRPC, for any program that uses nidaqmx.

    The first line on standard output is "Server listening on port N". Ctrl-C stops the server. The
    devices are those of --device, --devices or --bench, or a rig's, which measure its simulated plant.

    With a COMMAND after two hyphens, run it with the devices in place of NI's driver, and exit as it does.
    """
    asked = {"--device": named, "--devices": devices, "--bench": bench, "--tape": tape, "a command": command}
    own = [option for option, value in asked.items() if value]
    if rig is not None and own:
        raise click.UsageError(f"--rig and {own[0]} exclude each other: use one of them")
    if own:
        return _on_a_bench(named, devices, bench, tape, port, allow, command)
    # Each way imports what it needs: a server is there the sooner.
    from ..base.clock import RealClock  # noqa: PLC0415
    from ..base.errors import ConfigurationError  # noqa: PLC0415
    from ..base.validation import validate  # noqa: PLC0415
    from ..instruments import load_rig_file  # noqa: PLC0415
    from ..instruments.daq.ni_daqmx import NiDaq  # noqa: PLC0415
    from ..mocks.daq.twin import wiring_of  # noqa: PLC0415
    from ..mocks.plant import Plant  # noqa: PLC0415
    from ..nidaqmx_twin import inventory_of, run  # noqa: PLC0415

    file = load_rig_file(rig or "simulated")
    if file.daq.driver != "ni-daqmx" or not file.daq.settings.get("devices"):
        raise ConfigurationError(
            f"The rig {file.name!r} has no NI devices in [daq]: name another rig, or use --devices."
        )
    settings = validate(NiDaq.Settings, file.daq.settings, f"[daq] of {file.name}")
    plant = Plant(file, RealClock())
    run(inventory_of(settings.devices), port, plant, wiring_of(settings), plant.has_rtsi())
    return None


def _on_a_bench(
    named: tuple[str, ...],
    export: Path | None,
    bench: Path | None,
    tape: Path | None,
    port: int,
    allow: tuple[str, ...],
    command: tuple[str, ...],
) -> int:
    """Run a command whose nidaqmx finds simulated cards, and return its exit code; without one, serve."""
    from ..instruments.tape import Recorder, current  # noqa: PLC0415
    from ..mocks.bench import running  # noqa: PLC0415
    from ..nidaqmx_twin.bench import devices_of, read_bench  # noqa: PLC0415
    from ..nidaqmx_twin.standalone import run_command  # noqa: PLC0415

    said = read_bench(bench) if bench is not None else None
    listed = devices_of(named, export, said)
    if not listed and not (said and said.instruments):
        raise click.UsageError(
            "name the devices: by --device NAME=PRODUCT, by --devices FILE.ini, or by [devices] in --bench"
        )
    if allow and not (said and said.instruments):
        raise click.UsageError(
            "--allow is for a --bench with [instruments], under which nothing else is opened"
        )
    with tape_session(None, tape), ExitStack() as stack:
        deck = current()
        recorder = deck if isinstance(deck, Recorder) else None
        found = stack.enter_context(running(listed, said, port=port, tape=recorder))
        for sentence in found.twin.left_out if found.twin else ():
            note(sentence)
        if command:
            return run_command(command, found.environment(allow))
        if found.twin:
            click.echo(f"Server listening on port {found.twin.port}")
        for name, wire in found.tabled.wires.items():
            click.echo(f"{name}: {found.tabled.serial.get(name, wire.address)}")
        with _stopped() as stopped:
            # With a time-out, because Ctrl-C does not interrupt an unlimited wait on Windows.
            while not stopped.wait(0.25):
                pass
        for name, count in found.twin.unserved.items() if found.twin else ():
            click.echo(f"{name} was asked for {count} times and is not served.", err=True)
    return 0


@dataclass(frozen=True)
class _Serving:
    """What the options of a command say."""

    rig: str
    port: str | None
    pty: bool
    write: Path | None
    as_json: bool
    press: str | None = None
    command: tuple[str, ...] = ()
    allow: tuple[str, ...] = ()


def _serve(how: _Serving) -> int:
    """Serve wires on one plant until Ctrl-C, and print their addresses, or as long as a command runs."""
    from ..nidaqmx_twin.redirect import environment  # noqa: PLC0415
    from ..nidaqmx_twin.standalone import run_command  # noqa: PLC0415

    command = how.command
    asked = Asked(
        how.rig,
        ports_of(how.port),
        terminals=how.pty or (bool(command) and has_terminals()),
        own_ports=bool(command),
    )
    with served(asked) as found, _stopped() as stopped:
        if how.write is not None:
            found.write(how.write, how.rig)
        if command:
            pressing = threading.Thread(target=_wait, args=(stopped, found.plant, how.press), daemon=True)
            pressing.start()
            try:
                served_at = [
                    int(n) for address in found.addresses.values() for n in re.findall(r":(\d+)", address)
                ]
                around = environment(
                    found.addresses.get("ni"), found.serial, found.visa, how.allow, served_at
                )
                return run_command(command, around)
            finally:
                stopped.set()
                pressing.join()
        if how.as_json:
            click.echo(json.dumps(found.addresses))
        else:
            for name, address in found.addresses.items():
                click.echo(f"{name}: {address}")
        if found.others:
            click.echo(f"Not served, because they have no protocol: {', '.join(found.others)}.", err=True)
        _wait(stopped, found.plant, how.press)
    return 0


@contextmanager
def _stopped() -> Iterator[Flag]:
    """Give an event that Ctrl-C and SIGTERM set; both end serving normally, with exit code 0."""
    stopped = Flag()
    before = {
        number: signal.signal(number, lambda _number, _frame: stopped.set())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _wait(stopped: Flag, plant: Plant, press: str | None) -> None:
    """Wait until stopped; if `press` names a button, press it every `_EVERY` seconds."""
    from ..base.clock import RealClock  # noqa: PLC0415
    from ..instruments import Press  # noqa: PLC0415

    clock = RealClock()
    due, number = clock.now() + _EVERY, 1
    # With a time-out, because Ctrl-C does not interrupt an unlimited wait on Windows.
    while not stopped.wait(0.25):
        if press is not None and clock.now() >= due:
            plant.press(Press(press, "P01", number, number))
            due, number = due + _EVERY, number + 1


def _options(served: Callable[..., Any]) -> Callable[..., Any]:
    for option in (
        click.argument("command", nargs=-1, type=click.UNPROCESSED),
        _as_json,
        click.option(
            "--write",
            type=click.Path(path_type=Path, dir_okay=False),
            metavar="FILE.toml",
            help="Write a rig file that points at what is served.",
        ),
        click.option(
            "--pty", is_flag=True, help="Serve serial lines at device files. Not on Windows, which has none."
        ),
        _allow,
        click.option(
            "--port", metavar="KIND=N,...", help="TCP ports: ni=50051,yocto=4444. Others are free ones."
        ),
    ):
        served = option(served)
    return served


@twin.command("all", short_help="Serve all simulated instruments of a rig.")
@_rig
@click.option(
    "--press", metavar="BUTTON", help=f"Let a simulated person press this button every {_EVERY:g} s."
)
@_options
def serve_all(**how: Any) -> int:
    """Serve all simulated instruments of a rig that have a protocol, on one plant.

    With a COMMAND after two hyphens, run it and exit as it does. Its nidaqmx, pyserial and PyVISA find the
    simulated instruments under the names that the rig file gives: cards, ports such as COM3, VISA resources.
    A hub that the rig file has on this computer is at its own port. Any other port, resource, sound device or
    address of a network is refused, because it may be a real instrument: --allow names what may be opened.
    """
    return _serve(_Serving(**how))
