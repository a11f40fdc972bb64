from . import plot as plot
from .catalogue import Entry as Entry
from .contents import file_contents as file_contents
from .figures import trend as trend
from .html import PaperFigures as PaperFigures
from .html import write_figures as write_figures
from .html import write_recalibration as write_recalibration
from .html import write_report as write_report
