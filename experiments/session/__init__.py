"""Sessions of an experiment: durable logs, resuming, withdrawal and export."""

from .export import export_answers as export_answers
from .export import sidecar_of as sidecar_of
from .session import AGAIN as AGAIN
from .session import Answerer as Answerer
from .session import Presents as Presents
from .session import Session as Session
from .session import open_session as open_session
from .session import run_session as run_session
from .store import Event as Event
from .store import EventLog as EventLog
from .store import Store as Store
from .store import StoredSession as StoredSession
from .store import Withdrawal as Withdrawal
from .store import due_sessions as due_sessions
from .store import read_log as read_log
