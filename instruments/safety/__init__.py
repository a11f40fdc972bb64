"""Keep volts within limits and bring a rig to its safe state."""

from .abort_monitor import AbortMonitor as AbortMonitor
from .abort_monitor import trip as trip
from .audit import Audit as Audit
from .audit import entries as entries
from .audit import log_problems as log_problems
from .audit import now_utc as now_utc
from .audit import state_folder as state_folder
from .audit import who as who
from .deadline import exit_within as exit_within
from .deadline import run_within as run_within
from .figures import Figures as Figures
from .judge import combined as combined
from .limiter import Limiter as Limiter
from .lock import hold as hold
from .lock import reserve as reserve
from .lockout import Lockout as Lockout
from .lockout import Lockouts as Lockouts
from .lockout import clear_lockout as clear_lockout
from .lockout import lockout_of as lockout_of
from .lockout import lockouts_folder as lockouts_folder
from .outputs import Outputs as Outputs
from .renewal import Renewal as Renewal
from .safe_state import SafeState as SafeState
