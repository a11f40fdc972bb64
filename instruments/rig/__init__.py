"""A rig: all instruments of a rig file, opened together."""

from .json_schema import rig_schema as rig_schema
from .monitoring import UNPROVED as UNPROVED
from .monitoring import UnshownError as UnshownError
from .opening import hardware as hardware
from .opening import identify_each as identify_each
from .opening import log_entries as log_entries
from .opening import open_rig as open_rig
from .opening import reset_lockout as reset_lockout
from .rig import Rig as Rig
from .taping import check_recordable as check_recordable
from .taping import tape_rig as tape_rig
