"""Recording sessions: from the DAQ's stream to a study of many sessions."""

from .looking import look
from .recorder import record
from .study import (
    Study,
    StudyProgress,
    load_study,
    open_part,
    run_study,
    with_presses,
)
from .study_file import williams_row

__all__ = [
    "Study",
    "StudyProgress",
    "load_study",
    "look",
    "open_part",
    "record",
    "run_study",
    "williams_row",
    "with_presses",
]
