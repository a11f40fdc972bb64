"""Recording sessions: from the DAQ's stream to a study of many sessions."""

from .recorder import look as look
from .recorder import record as record
from .study import Study as Study
from .study import StudyProgress as StudyProgress
from .study import load_study as load_study
from .study import open_part as open_part
from .study import run_study as run_study
from .study import with_presses as with_presses
from .study_file import StudyFile as StudyFile
from .study_file import load_study_file as load_study_file
from .study_file import williams_row as williams_row
