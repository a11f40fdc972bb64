"""Files that describe a rig: the rig file and the force sensor's calibration file."""

from .actuator import Actuator
from .contradictions import lacks, range_of
from .model_file import load_model
from .ratings import RatingSource, require_source
from .rig_file import (
    AbortLimits,
    Device,
    People,
    Recalibration,
    RigFile,
    SimulationSettings,
    TableSettings,
    roles,
)
from .rig_reading import fault_kinds, load_rig_file
from .toml_lines import key_lines, parse_toml, place, read_text
from .validation import told, validate, validate_kind

__all__ = [
    "AbortLimits",
    "Actuator",
    "Device",
    "People",
    "RatingSource",
    "Recalibration",
    "RigFile",
    "SimulationSettings",
    "TableSettings",
    "fault_kinds",
    "key_lines",
    "lacks",
    "load_model",
    "load_rig_file",
    "parse_toml",
    "place",
    "range_of",
    "read_text",
    "require_source",
    "roles",
    "told",
    "validate",
    "validate_kind",
]
