"""Perception: thresholds of vibrotactile detection, levels above them, and what a finger would feel."""

from .feeling import Answer, Feeling, feeling_of
from .levels import LONG, SHORT, Levels, levels_of, running_level
from .thresholds import (
    Curve,
    Difference,
    Thresholds,
    parse_thresholds,
    thresholds,
)

__all__ = [
    "LONG",
    "SHORT",
    "Answer",
    "Curve",
    "Difference",
    "Feeling",
    "Levels",
    "Thresholds",
    "feeling_of",
    "levels_of",
    "parse_thresholds",
    "running_level",
    "thresholds",
]
