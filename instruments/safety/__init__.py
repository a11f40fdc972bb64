"""Keep volts within limits and bring a rig to its safe state."""

from .abort_monitor import AbortMonitor, trip
from .audit import Audit, entries, log_problems, now_utc, state_folder, who
from .deadline import exit_within, run_within
from .figures import Figures
from .judge import combined
from .limiter import Limiter
from .lock import hold, is_marked, marked, reserve
from .lockout import Lockout, Lockouts, clear_lockout, lockout_of, lockouts_folder
from .outputs import Outputs
from .renewal import Renewal
from .safe_state import SafeState

__all__ = [
    "AbortMonitor",
    "Audit",
    "Figures",
    "Limiter",
    "Lockout",
    "Lockouts",
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
