"""The wire as a separate program in real time, for any nidaqmx program, which it can run to its end."""

from __future__ import annotations

import configparser
import re
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ..base.errors import ConfigurationError, InstrumentError
from ..base.signals import STOPPING
from ..base.threads import Flag
from ..base.wording import did_you_mean
from .devices import Inventory, NiDevice, devices_from_ini
from .nodes import Nodes
from .products import PRODUCTS, Product, described
from .server import NiServer

_IN_A_SLOT = re.compile(r"(.+)Mod(\d+)")


def inventory_of(devices: Mapping[str, str], products: Mapping[str, Product] | None = None) -> Inventory:
    """Create the inventory of a rig file's devices, a mapping of device name to product name.

    `products` are those that are known, of the table unless others are given.

    A module stands in the chassis and slot that its name says, as NI MAX names it ("cDAQ1Mod2"); any other in
    the first chassis of `devices`. A chassis that is not listed is a cDAQ-9178.
    Raises ConfigurationError for an unknown product.
    """
    known = described({}) if products is None else products
    for name, product in devices.items():
        if product not in known:
            hint = did_you_mean(product, known, "there are")
            raise ConfigurationError(f"There is no simulated {product!r} ({name}); {hint}")
    cards = [NiDevice(name, known[product]) for name, product in devices.items()]
    modules = [card for card in cards if card.product.family in ("C Series", "TestScale")]
    if not modules:
        return Inventory.of(cards)
    own = [card.name for card in cards if card.product.slots]
    placed: dict[str, list[NiDevice]] = {}
    for module in modules:
        named = _IN_A_SLOT.fullmatch(module.name)
        home = named[1] if named else own[0] if own else "cDAQ1"
        slot = int(named[2]) if named else len(placed.get(home, [])) + 1
        placed.setdefault(home, []).append(replace(module, chassis=home, slot=slot))
    added = [NiDevice(home, PRODUCTS["cDAQ-9178"]) for home in placed if home not in own]
    inside = {module.name: module for group in placed.values() for module in group}
    return Inventory.of([*added, *(inside.get(card.name, card) for card in cards)])


def inventory_from_file(path: Path) -> Inventory:
    """Read the inventory from an NI MAX text export.

    Raises ConfigurationError when it cannot be read, or lists no device that can be simulated.
    """
    try:
        # MAX writes in Windows' local code page; only names and comments can be affected.
        inventory = devices_from_ini(path.read_text(encoding="utf-8-sig", errors="replace"))
    except OSError as error:
        raise ConfigurationError(f"The device file {path} cannot be read: {error.strerror}.") from None
    except (ValueError, configparser.Error) as error:
        reason = " ".join(str(error).split())[:80]
        raise ConfigurationError(
            f"{path} is not a text export of NI MAX ({reason}): export it again."
        ) from None
    if not inventory.devices:
        why = " ".join(inventory.left_out) or "Export the devices from NI MAX, as text."
        raise ConfigurationError(f"The device file {path} lists no device that can be simulated. {why}")
    return inventory


def run(
    inventory: Inventory,
    port: int = 0,
    nodes: Nodes | None = None,
    wiring: Mapping[str, str] | None = None,
    rtsi: bool = True,
) -> None:
    """Serve `inventory` until Ctrl-C or SIGTERM.

    The first line on standard output is "Server listening on port N"; devices that are left out
    are named on standard error. Raises InstrumentError when the port is not available.
    """
    for sentence in inventory.left_out:
        print(sentence, file=sys.stderr, flush=True)
    try:
        server = NiServer(inventory, nodes, wiring, port=port, rtsi=rtsi)
    except RuntimeError as error:
        why = str(error).rstrip(".")
        raise InstrumentError(f"The NI wire cannot listen on port {port}: {why}.") from None
    with server:
        serve(server.port, server.unserved)


def serve(port: int, unserved: Mapping[str, int]) -> None:
    """Say that a server listens, wait for Ctrl-C or SIGTERM, and name what was asked for in vain."""
    told = Flag()
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, lambda _number, _frame: told.set())
    print(f"Server listening on port {port}", flush=True)
    # On Windows a wait without a time-out cannot be interrupted.
    while not told.wait(0.25):
        pass
    for name, count in unserved.items():
        print(f"{name} was asked for {count} times and is not served.", file=sys.stderr, flush=True)


# Another program, run to its end.

_PATIENCE = 3
"""Ctrl-C or SIGTERM as often as this kills the program that is run."""


def run_command(command: Sequence[str], environment: Mapping[str, str]) -> int:
    """Run another program and return its exit code. Raises ConfigurationError when there is none.

    A program that a signal ended has 128 and the signal's number, as a shell says it. Ctrl-C reaches the
    program as well, and SIGTERM is handed on. The program may end by either as it means to: it is waited
    for, and killed at the third.
    """
    try:
        program = subprocess.Popen(command, env=dict(environment))
    except OSError as error:
        raise ConfigurationError(f"{command[0]} cannot be run: {error.strerror}.") from None
    # Counted, not raised: an exception as the program ends would lose its exit code, which is told once.
    stops: list[int] = []

    def stop(number: int, _: object) -> None:
        stops.append(number)
        if len(stops) == _PATIENCE:
            program.kill()
        elif number != signal.SIGINT:
            program.terminate()

    before = ((number, signal.getsignal(number)) for number in STOPPING)
    heeded = {number: handler for number, handler in before if handler != signal.SIG_IGN}
    with program:
        try:
            for number in heeded:
                signal.signal(number, stop)
            code = None
            while code is None:
                # With a time-out, because Ctrl-C does not interrupt an unlimited wait on Windows.
                with suppress(subprocess.TimeoutExpired):
                    code = program.wait(0.25)
        finally:
            for number, handler in heeded.items():
                signal.signal(number, handler)
    return code if code >= 0 else 128 - code
