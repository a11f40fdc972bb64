"""Files of any program, read as columns of numbers with their headings and units."""

from .readers import FORMATS, format_of, read_table
from .table import Column, Labels, Stated, Table
from .text_rows import is_blank
from .tree_responses import has_responses, read_responses
from .units import SI, WEIGHTS, per_unit, unit_of, units_of

__all__ = [
    "FORMATS",
    "SI",
    "WEIGHTS",
    "Column",
    "Labels",
    "Stated",
    "Table",
    "format_of",
    "has_responses",
    "is_blank",
    "per_unit",
    "read_responses",
    "read_table",
    "unit_of",
    "units_of",
]  # fmt: skip
