"""Self-contained HTML reports."""

from haploop.report import captions
from haploop.report.data import Report, write_report
from haploop.report.html import CaptionedFigure, render
from haploop.report.recalibration import write_recalibration

__all__ = ["CaptionedFigure", "Report", "captions", "render", "write_recalibration", "write_report"]
