"""Files that describe a rig: the rig file and the force sensor's calibration file."""

from .actuator import Actuator as Actuator
from .contradictions import lacks as lacks
from .contradictions import range_of as range_of
from .rig_file import AbortLimits as AbortLimits
from .rig_file import Device as Device
from .rig_file import People as People
from .rig_file import RatingSource as RatingSource
from .rig_file import Recalibration as Recalibration
from .rig_file import RigFile as RigFile
from .rig_file import SimulationSettings as SimulationSettings
from .rig_file import TableSettings as TableSettings
from .rig_file import require_source as require_source
from .rig_file import roles as roles
from .rig_reading import fault_kinds as fault_kinds
from .rig_reading import load_model as load_model
from .rig_reading import load_rig_file as load_rig_file
from .rig_reading import problems_of as problems_of
from .rig_reading import rig_text as rig_text
from .rig_reading import shipped_rig as shipped_rig
from .rig_reading import shipped_rigs as shipped_rigs
