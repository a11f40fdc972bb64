"""Pick-ups of the table's motion: the role, and its drivers."""

from .role import DERIVATIVE, QUANTITIES, UNITS, Quantity, Vibrometer, shown

__all__ = ["DERIVATIVE", "QUANTITIES", "UNITS", "Quantity", "Vibrometer", "shown"]
