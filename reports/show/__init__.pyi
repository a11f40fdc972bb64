from .meter import Meter as Meter
from .meter import StudyMeter as StudyMeter
from .meter import rejection_line as rejection_line
from .terminal import print_contents as print_contents
from .terminal import print_made as print_made
