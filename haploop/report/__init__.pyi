from . import captions as captions
from .data import Report as Report
from .data import write_report as write_report
from .html import CaptionedFigure as CaptionedFigure
from .html import render as render
from .recalibration import write_recalibration as write_recalibration
