"""The wire as a separate program in real time, for any nidaqmx program."""

from __future__ import annotations

import configparser
import re
import signal
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from ..base.errors import ConfigurationError, InstrumentError
from ..base.flag import Flag
from ..base.near_words import did_you_mean
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
