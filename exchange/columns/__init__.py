"""Files of any program, read as columns of numbers with their headings and units."""

from .readers import FORMATS, format_of, read_table
from .table import Column, Table
from .units import SI, per_unit, unit_of

__all__ = ["FORMATS", "SI", "Column", "Table", "format_of", "per_unit", "read_table", "unit_of"]
