"""`haploop twin`: serve simulated instruments to other programs."""

from __future__ import annotations

import json
import signal
import threading
from pathlib import Path
from typing import Any

import click

__all__ = ["twin"]

_SERVED = {
    "ni": ("daq", "server"),
    "yocto": ("relay", "hub"),
    "ofv": ("vibrometer", "port"),
    "scpi": ("generator", "resource"),
}
"""Kind of wire: its role, and the driver setting that holds its address."""

_rig = click.option("--rig", "-r", metavar="FILE", help="Rig whose instruments are simulated.")


@click.group(no_args_is_help=True)
def twin() -> None:
    """Serve simulated instruments to other programs.

    The instruments run in real time and use their own protocols.
    """


@twin.command()
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=True,
    help="TCP port; 0 selects a free one.",
)
@_rig
@click.option(
    "--devices",
    type=click.Path(path_type=Path),
    metavar="FILE.ini",
    help="Serve the devices in this NI MAX text export.",
)
def ni(port: int, rig: str | None, devices: Path | None) -> None:
    """Serve simulated NI-DAQmx devices over gRPC, for any program that uses nidaqmx.

    The first line on standard output is "Server listening on port N". Ctrl-C stops the server. The
    devices measure the rig's simulated plant; the default rig is "simulated".
    """
    from haploop.instruments import ConfigurationError, RealClock, load_rig_file  # noqa: PLC0415
    from haploop.instruments.config import validate  # noqa: PLC0415
    from haploop.instruments.daq.ni_daqmx import NiDaq  # noqa: PLC0415
    from haploop.mocks.daq.ni import inventory_from_file, inventory_of, run, wiring_of  # noqa: PLC0415
    from haploop.mocks.plant import Plant  # noqa: PLC0415

    if devices is not None and rig is not None:
        raise click.UsageError("--rig and --devices exclude each other: use one of them")
    if devices is not None:
        run(inventory_from_file(devices), port)
        return
    file = load_rig_file(rig or "simulated")
    if file.daq.driver != "ni-daqmx" or not file.daq.settings.get("devices"):
        raise ConfigurationError(
            f"The rig {file.name!r} has no NI devices in [daq]: name another rig, or use --devices."
        )
    settings = validate(NiDaq.Settings, file.daq.settings, f"[daq] of {file.name}")
    plant = Plant(file, RealClock())
    run(inventory_of(settings.devices), port, plant, wiring_of(settings), plant.has_rtsi())


def _serve(kinds: tuple[str, ...], rig: str | None, as_json: bool) -> None:
    """Serve wires on one plant until Ctrl-C, and print their addresses."""
    from haploop.instruments import ConfigurationError, RealClock, entry_points, load_rig_file  # noqa: PLC0415
    from haploop.instruments.config import validate  # noqa: PLC0415
    from haploop.mocks.simulation import Simulation  # noqa: PLC0415

    file = load_rig_file(rig or "bench")
    wires = entry_points.installed(entry_points.WIRES)
    wanted = {_SERVED[kind][0]: kind for kind in kinds}
    told = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: told.set())
    simulation = Simulation(file, RealClock())
    addresses: dict[str, str] = {}
    try:
        for role, device in file.devices.items():
            driver: Any = entry_points.driver_class(device.driver, role)
            if role in wanted and device.driver in wires:
                settings = validate(driver.Settings, device.settings, f"[{role}] of {file.name}")
                kind = wanted[role]
                addresses[kind] = str(simulation.serve(device.driver, settings)[_SERVED[kind][1]])
            else:
                # Instruments that are not served are part of the plant too: a laser must be in place.
                simulation.instrument(role, device, driver, "twin")
        missing = [kind for kind in kinds if kind not in addresses]
        if missing:
            raise ConfigurationError(
                f"The rig {file.name!r} has no instrument to serve as {', '.join(missing)}: name another rig."
            )
        if as_json:
            click.echo(json.dumps(addresses))
        else:
            for kind, address in addresses.items():
                click.echo(f"{kind}: {address}")
        # With a time-out, because a wait without one cannot be interrupted on Windows.
        while not told.wait(0.25):
            pass
    finally:
        simulation.close()


def _command(name: str, kinds: tuple[str, ...], help_text: str) -> None:
    @twin.command(name, help=help_text)
    @_rig
    @click.option("--json", "as_json", is_flag=True, help="Print the addresses as one JSON object.")
    def serve(rig: str | None, as_json: bool) -> None:
        _serve(kinds, rig, as_json)


_command("all", tuple(_SERVED), "Serve all simulated instruments of a rig, on one plant.")
_command("yocto", ("yocto",), "Serve a Yoctopuce hub with a relay box over HTTP.")
_command("ofv", ("ofv",), "Serve an OFV-5000 vibrometer on a serial line.")
_command("scpi", ("scpi",), "Serve a function generator on a SCPI socket.")
