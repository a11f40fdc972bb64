"""Simulated relay boxes: the box itself, twins and wires."""

from .box import BoxAdapter, BoxFault, Contacts, RelayTwin, SimulatedBox, box_in
from .serial_relay import SerialRelayTwin, SerialRelayWire
from .yocto_hub import YoctoHub

__all__ = [
    "BoxAdapter",
    "BoxFault",
    "Contacts",
    "RelayTwin",
    "SerialRelayTwin",
    "SerialRelayWire",
    "SimulatedBox",
    "YoctoHub",
    "box_in",
]
