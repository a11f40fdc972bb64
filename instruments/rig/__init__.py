"""A rig: all instruments of a rig file, opened together."""

from .gain_proof import UNPROVED, UnshownError
from .json_schema import rig_schema
from .logbook import log_entries, reset_lockout
from .opening import hardware, open_rig
from .rig import Rig
from .taping import check_recordable, tape_rig

__all__ = [
    "UNPROVED",
    "Rig",
    "UnshownError",
    "check_recordable",
    "hardware",
    "log_entries",
    "open_rig",
    "reset_lockout",
    "rig_schema",
    "tape_rig",
]
