"""A rig: all instruments of a rig file, opened together."""

from .gain_proof import UNPROVED as UNPROVED
from .gain_proof import UnshownError as UnshownError
from .json_schema import rig_schema as rig_schema
from .logbook import log_entries as log_entries
from .logbook import reset_lockout as reset_lockout
from .opening import hardware as hardware
from .opening import identify_each as identify_each
from .opening import open_rig as open_rig
from .rig import Rig as Rig
from .taping import check_recordable as check_recordable
from .taping import tape_rig as tape_rig
