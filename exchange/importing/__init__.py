"""Files of any lab: read as columns, understood with a mapping, imported as a recording or a press."""

from ..columns import FORMATS
from .files import becomes, destination, import_file
from .mapping import ROLES, FileMapping
from .names import named
from .press import import_press, press_of, presses_in
from .recording import import_recording
from .response import import_response, is_response_file
from .understanding import Question, Signal, Understanding, understand

__all__ = [
    "FORMATS",
    "ROLES",
    "FileMapping",
    "Question",
    "Signal",
    "Understanding",
    "becomes",
    "destination",
    "import_file",
    "import_press",
    "import_recording",
    "import_response",
    "is_response_file",
    "named",
    "press_of",
    "presses_in",
    "understand",
]
