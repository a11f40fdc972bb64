"""Keep volts within limits and bring a rig to its safe state."""

from haploop.instruments.safety.abort_monitor import AbortMonitor, trip
from haploop.instruments.safety.audit import Audit, entries, log_problems, now_utc, state_folder, who
from haploop.instruments.safety.deadline import exit_within, run_within
from haploop.instruments.safety.limiter import Limiter, combined
from haploop.instruments.safety.lock import hold, is_marked, marked, reserve
from haploop.instruments.safety.lockout import Lockout, clear_lockout, lockout_of, lockouts_folder
from haploop.instruments.safety.outputs import Outputs
from haploop.instruments.safety.renewal import Renewal
from haploop.instruments.safety.safe_state import SafeState

__all__ = [
    "AbortMonitor",
    "Audit",
    "Limiter",
    "Lockout",
    "Outputs",
    "Renewal",
    "SafeState",
    "clear_lockout",
    "combined",
    "entries",
    "exit_within",
    "hold",
    "is_marked",
    "lockout_of",
    "lockouts_folder",
    "log_problems",
    "marked",
    "now_utc",
    "reserve",
    "run_within",
    "state_folder",
    "trip",
    "who",
]
