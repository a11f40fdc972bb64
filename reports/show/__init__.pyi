from .meter import Meter as Meter
from .meter import rejection_line as rejection_line
from .study_meter import StudyMeter as StudyMeter
from .terminal import print_contents as print_contents
from .terminal import print_made as print_made
