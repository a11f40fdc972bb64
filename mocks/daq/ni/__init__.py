"""The NI-DAQmx wire: simulated NI devices behind NI's own gRPC service."""

from haploop.mocks.daq.ni.devices import Inventory, NiDevice, devices_from_ini
from haploop.mocks.daq.ni.server import NiServer
from haploop.mocks.daq.ni.standalone import inventory_from_file, inventory_of, run
from haploop.mocks.daq.ni.wire import wire, wiring_of

__all__ = [
    "Inventory",
    "NiDevice",
    "NiServer",
    "devices_from_ini",
    "inventory_from_file",
    "inventory_of",
    "run",
    "wire",
    "wiring_of",
]
