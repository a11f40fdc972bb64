"""Files of any program, read as columns of numbers with their headings and units."""

from .readers import FORMATS, format_of, read_table
from .start_times import LABVIEW_EPOCH, Start, instant, since_epoch, zone_of
from .table import Column, Labels, Stated, Table
from .text_cells import is_blank
from .tree_table import has_responses, read_responses
from .units import SI, WEIGHTS, per_unit, unit_of, units_of

__all__ = [
    "FORMATS",
    "LABVIEW_EPOCH",
    "SI",
    "WEIGHTS",
    "Column",
    "Labels",
    "Start",
    "Stated",
    "Table",
    "format_of",
    "has_responses",
    "instant",
    "is_blank",
    "per_unit",
    "read_responses",
    "read_table",
    "since_epoch",
    "unit_of",
    "units_of",
    "zone_of",
]  # fmt: skip
