from . import captions as captions
from .data import Report as Report
from .data import write_report as write_report
from .recalibration import write_recalibration as write_recalibration
from .rendering import CaptionedFigure as CaptionedFigure
from .rendering import render as render
