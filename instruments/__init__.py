"""What a rig is made of: role interfaces, sensors, limits, the rig file, and one file per product driven."""

from instruments.amplifier import Amplifier
from instruments.clock import Clock, RealClock
from instruments.daq import Block, Capture, Daq, Stream
from instruments.errors import ConfigurationError, DataError, HaploopError, InstrumentError, LimitError
from instruments.generator import Generator, Sweep
from instruments.limits import Limits
from instruments.opening import open_rig
from instruments.operator import (
    Aim,
    ConfirmSettings,
    Consent,
    Operator,
    Place,
    Press,
    Ready,
    Remove,
    Request,
    Rest,
)
from instruments.player import Player
from instruments.relay import Relay
from instruments.rig import Rig
from instruments.rig_file import RigFile, load_rig_file
from instruments.sensors import Accelerometer, Divider, ForceTorque, Sensor, Sensors, Switch
from instruments.vibrometer import Vibrometer

__all__ = [
    "Accelerometer",
    "Aim",
    "Amplifier",
    "Block",
    "Capture",
    "Clock",
    "ConfigurationError",
    "ConfirmSettings",
    "Consent",
    "Daq",
    "DataError",
    "Divider",
    "ForceTorque",
    "Generator",
    "HaploopError",
    "InstrumentError",
    "LimitError",
    "Limits",
    "Operator",
    "Place",
    "Player",
    "Press",
    "Ready",
    "RealClock",
    "Relay",
    "Remove",
    "Request",
    "Rest",
    "Rig",
    "RigFile",
    "Sensor",
    "Sensors",
    "Stream",
    "Sweep",
    "Switch",
    "Vibrometer",
    "load_rig_file",
    "open_rig",
]
