"""Sensors: values that convert volts to SI, described in the rig file by what they measure."""

from .rest import fault_along_vertical, fault_at_rest, loss, upside_down
from .restoring import Restorer
from .sensor import UNITS, AnalogChannel, Divider, LinearSensor, Scale, Sensor, Switch
from .sensors import Sensors
from .tables import (
    AccelerationTable,
    Described,
    DisplacementTable,
    ForceTable,
    LinearTable,
    VelocityTable,
)
from .transfer import Measured, Transfer, high_pass, low_pass
from .units import G, value_of, with_unit

__all__ = [
    "UNITS",
    "AccelerationTable",
    "AnalogChannel",
    "Described",
    "DisplacementTable",
    "Divider",
    "ForceTable",
    "G",
    "LinearSensor",
    "LinearTable",
    "Measured",
    "Restorer",
    "Scale",
    "Sensor",
    "Sensors",
    "Switch",
    "Transfer",
    "VelocityTable",
    "fault_along_vertical",
    "fault_at_rest",
    "high_pass",
    "loss",
    "low_pass",
    "upside_down",
    "value_of",
    "with_unit",
]
