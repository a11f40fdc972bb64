"""The NI-DAQmx wire: simulated NI devices behind NI's own gRPC service."""

from .bench import NiTwin
from .devices import Inventory, NiDevice, devices_from_ini
from .server import NiServer
from .standalone import inventory_from_file, inventory_of, run
from .wire import wire, wiring_of

__all__ = [
    "Inventory",
    "NiDevice",
    "NiServer",
    "NiTwin",
    "devices_from_ini",
    "inventory_from_file",
    "inventory_of",
    "run",
    "wire",
    "wiring_of",
]
