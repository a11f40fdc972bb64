"""A new rig file from a shipped one, and what this computer has for it."""

from .found import Found as Found
from .found import FoundCard as FoundCard
from .found import look_for_hardware as look_for_hardware
from .new_rig import LOOK_UP as LOOK_UP
from .new_rig import new_rig as new_rig
from .new_rig import new_rig_on as new_rig_on
from .new_rig import rig_problems as rig_problems
from .new_rig import to_look_up as to_look_up
