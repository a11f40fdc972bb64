"""Simulated NI cards (`nidaqmx_twin`) as the wire of a rig."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ...instruments.daq.ni_daqmx import NiDaq
from ...instruments.daq.ni_settings import device_of
from ...nidaqmx_twin import NiServer, inventory_of
from ...nidaqmx_twin.products import described
from ..plant import Plant

# NI wire of a rig: its cards, with their terminals connected as in the rig file.


@contextmanager
def wire(settings: NiDaq.Settings, plant: Plant) -> Iterator[dict[str, Any]]:
    """Serve the cards of `settings` on `plant`; yield the setting that points the driver at them.

    Channels and outputs are nodes of the plant with the same names.
    """
    for name, channel in settings.channels.items():
        plant.sample_by(name, device_of(channel.terminal))
    inventory = inventory_of(settings.devices, described(settings.products))
    wiring, rtsi = wiring_of(settings), plant.has_rtsi()
    with NiServer(inventory, plant, wiring, rtsi=rtsi, seed=plant.settings.seed) as server:
        yield {"server": server.address}


def wiring_of(settings: NiDaq.Settings) -> dict[str, str]:
    """Return the plant's node for each terminal of the cards."""
    inputs = {channel.terminal: name for name, channel in settings.channels.items()}
    return inputs | {output.terminal: name for name, output in settings.outputs.items()}
