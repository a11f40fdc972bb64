"""The plant: the simulated physical world of a rig, and the hooks for faults."""

from haploop.mocks.plant.amplifier import AMPLIFIER_GAIN_ERROR
from haploop.mocks.plant.bouc_wen import BoucWen
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
from haploop.mocks.plant.hysteresis import Hysteresis, PatchLaw
from haploop.mocks.plant.modal import ModalSurface, Modes
from haploop.mocks.plant.modal_plant import Modal, random_modal
from haploop.mocks.plant.nodes import (
    LaserHead,
    Nodes,
    PlayStopped,
    Run,
    SamplesLost,
    Source,
    Switched,
    Switches,
)
from haploop.mocks.plant.plant import Plant
from haploop.mocks.plant.scene import AmplifierOutput
from haploop.mocks.plant.surface import (
    AMPLIFIER_POLE_HZ,
    REMEMBERED,
    PlantSettings,
    PlantSource,
    Surface,
    place_of,
    table_of,
)
from haploop.mocks.plant.table import TouchTable
from haploop.mocks.plant.touches import SimulatedTouch
from haploop.mocks.plant.truth import Truth

__all__ = [
    "AMPLIFIER_GAIN_ERROR",
    "AMPLIFIER_POLE_HZ",
    "KINDS",
    "REMEMBERED",
    "AmplifierOutput",
    "BoucWen",
    "Fault",
    "FaultKinds",
    "FaultSettings",
    "Faults",
    "Hysteresis",
    "LaserHead",
    "Modal",
    "ModalSurface",
    "Modes",
    "Nodes",
    "NotNegative",
    "PatchLaw",
    "PerEventFault",
    "Plant",
    "PlantSettings",
    "PlantSource",
    "PlayStopped",
    "Positive",
    "RelayFailure",
    "Run",
    "SamplesLost",
    "ScheduledFault",
    "SimulatedTouch",
    "Source",
    "Surface",
    "Switched",
    "Switches",
    "TimedFault",
    "TouchTable",
    "Truth",
    "fault_class",
    "place_of",
    "random_modal",
    "table_of",
]
