"""Recording sessions: from the DAQ's stream to a study of many sessions."""

from haploop.acquisition.session.recorder import record
from haploop.acquisition.session.study import (
    Study,
    StudyProgress,
    load_study,
    open_part,
    run_study,
    with_presses,
)
from haploop.acquisition.session.study_file import williams_row

__all__ = [
    "Study",
    "StudyProgress",
    "load_study",
    "open_part",
    "record",
    "run_study",
    "williams_row",
    "with_presses",
]
