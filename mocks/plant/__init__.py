"""The plant: the simulated physical world of a rig, and the hooks for faults."""

from haploop.mocks.plant.amplifier import AMPLIFIER_GAIN_ERROR
from haploop.mocks.plant.fault import (
    Fault,
    FaultSettings,
    NotNegative,
    PerEventFault,
    Positive,
    RelayFailure,
    ScheduledFault,
    TimedFault,
)
from haploop.mocks.plant.fault_kinds import KINDS, FaultKinds, Faults, fault_class
from haploop.mocks.plant.nodes import LaserHead, Nodes, Run, SamplesLost, Source, Switched, Switches
from haploop.mocks.plant.plant import Plant
from haploop.mocks.plant.scene import AmplifierOutput
from haploop.mocks.plant.table import Plate
from haploop.mocks.plant.truth import Truth

__all__ = [
    "AMPLIFIER_GAIN_ERROR",
    "KINDS",
    "AmplifierOutput",
    "Fault",
    "FaultKinds",
    "FaultSettings",
    "Faults",
    "LaserHead",
    "Nodes",
    "NotNegative",
    "PerEventFault",
    "Plant",
    "Plate",
    "Positive",
    "RelayFailure",
    "Run",
    "SamplesLost",
    "ScheduledFault",
    "Source",
    "Switched",
    "Switches",
    "TimedFault",
    "Truth",
    "fault_class",
]
