"""Sessions of an experiment: durable logs, resuming, withdrawal and export."""

from .export import export_answers, sidecar_of
from .log import Event, EventLog, read_log
from .session import (
    AGAIN,
    Answerer,
    Presents,
    Session,
    open_session,
    run_session,
)
from .store import Store, StoredSession, Withdrawal

__all__ = [
    "AGAIN",
    "Answerer",
    "Event",
    "EventLog",
    "Presents",
    "Session",
    "Store",
    "StoredSession",
    "Withdrawal",
    "export_answers",
    "open_session",
    "read_log",
    "run_session",
    "sidecar_of",
]
