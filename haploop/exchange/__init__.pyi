from .formats import FORMATS as FORMATS
from .formats import Exported as Exported
from .formats import export_file as export_file
from .importing import import_press as import_press
from .importing import import_response as import_response
from .importing import is_response_file as is_response_file
