"""Simulated relay boxes: the box itself, twins and wires."""

from .box import BoxAdapter as BoxAdapter
from .box import BoxFault as BoxFault
from .box import Contacts as Contacts
from .box import RelayTwin as RelayTwin
from .box import SimulatedBox as SimulatedBox
from .box import box_in as box_in
from .serial_relay import SerialRelayTwin as SerialRelayTwin
from .serial_relay import SerialRelayWire as SerialRelayWire
from .yocto_hub import YoctoHub as YoctoHub
