"""The wire of a rig: its cards, each terminal connected to what the rig file connects it to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mocks.ni.server import NiServer
from mocks.ni.standalone import inventory_of

if TYPE_CHECKING:  # The plant is not needed to serve devices that nothing drives.
    from instruments.ni_daqmx import NiDaq
    from mocks.plant import Plant

__all__ = ["wire"]


@contextmanager
def wire(settings: NiDaq.Settings, plant: Plant) -> Iterator[dict[str, Any]]:
    """Serve the cards of `settings` on `plant`; gives the setting that points the driver at them.

    Channels and outputs are nodes of the plant by their own names. The cards have a RTSI cable.
    """
    wiring = {channel.terminal: name for name, channel in settings.channels.items()}
    wiring |= {output.terminal: name for name, output in settings.outputs.items()}
    inventory = inventory_of(settings.devices)
    with NiServer(inventory, plant, wiring, rtsi=True, seed=plant.settings.seed) as server:
        yield {"server": server.address}
