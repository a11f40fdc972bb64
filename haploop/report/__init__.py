"""Self-contained HTML reports."""

from haploop.report.html import CaptionedFigure, render
from haploop.report.recalibration import write_recalibration

__all__ = ["CaptionedFigure", "render", "write_recalibration"]
