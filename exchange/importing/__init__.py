"""Files of any lab: read as columns, understood with a mapping, imported as a recording or a press."""

from .mapping import ROLES, Mapping
from .press import import_press, press_of, presses_in
from .readers import FORMATS
from .response import import_response, is_response_file
from .understanding import Question, Signal, Understanding, understand

__all__ = [
    "FORMATS",
    "ROLES",
    "Mapping",
    "Question",
    "Signal",
    "Understanding",
    "import_press",
    "import_response",
    "is_response_file",
    "press_of",
    "presses_in",
    "understand",
]
