"""The plant: the simulated physical world of a rig, and the hooks for faults."""

from .amplifier import AMPLIFIER_GAIN_ERROR
from .bouc_wen import BoucWen
from .fault import (
    Fault,
    FaultSettings,
    NotNegative,
    PerEventFault,
    Positive,
    RelayFailure,
    ScheduledFault,
    TimedFault,
)
from .fault_kinds import KINDS, FaultKinds, Faults, fault_class
from .hysteresis import Hysteresis, PatchLaw
from .modal import ModalSurface, Modes
from .modal_plant import Modal, random_modal
from .nodes import (
    LaserHead,
    Nodes,
    PlayStopped,
    Run,
    SamplesLost,
    Source,
    Switched,
    Switches,
)
from .plant import Plant
from .scene import AmplifierOutput
from .surface import (
    AMPLIFIER_POLE_HZ,
    REMEMBERED,
    PlantSettings,
    PlantSource,
    Surface,
    place_of,
    table_of,
)
from .table import TouchTable
from .touches import SimulatedTouch
from .truth import Truth

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
