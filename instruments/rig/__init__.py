"""A rig: all instruments of a rig file, opened together."""

from haploop.instruments.rig.json_schema import rig_schema
from haploop.instruments.rig.logbook import log_entries, reset_lockout
from haploop.instruments.rig.opening import hardware, open_rig
from haploop.instruments.rig.rig import Rig

__all__ = ["Rig", "hardware", "log_entries", "open_rig", "reset_lockout", "rig_schema"]
