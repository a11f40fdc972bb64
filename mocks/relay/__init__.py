"""Simulated relay boxes: the box itself, twins and wires."""

from haploop.mocks.relay.box import BoxAdapter, BoxFault, Contacts, RelayTwin, SimulatedBox, box_in
from haploop.mocks.relay.serial_relay import SerialRelayTwin, SerialRelayWire
from haploop.mocks.relay.yocto_hub import YoctoHub

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
