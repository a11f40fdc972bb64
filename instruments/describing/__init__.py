"""Describe a rig by answering: what this computer has is offered, and the answers become a rig file."""

from .found import Found, FoundCard, look_for_hardware
from .interview import Interview
from .new_rig import new_rig, new_rig_on

__all__ = ["Found", "FoundCard", "Interview", "look_for_hardware", "new_rig", "new_rig_on"]
