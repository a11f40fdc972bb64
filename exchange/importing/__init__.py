"""Files of any lab: read as columns, understood with a mapping, imported as a recording or a press."""

from ..columns import FORMATS as FORMATS
from .curve import curve_of as curve_of
from .files import becomes as becomes
from .files import destination as destination
from .files import import_file as import_file
from .files import import_response as import_response
from .files import is_response_file as is_response_file
from .press import import_press as import_press
from .press import press_of as press_of
from .press import presses_in as presses_in
from .recording import import_recording as import_recording
from .roles import each_of as each_of
from .roles import named as named
from .understanding import understand as understand
from .understood import ROLES as ROLES
from .understood import FileMapping as FileMapping
from .understood import Question as Question
from .understood import Signal as Signal
from .understood import Understanding as Understanding
