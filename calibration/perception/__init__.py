"""Perception: thresholds of vibrotactile detection by act, levels above them, and what people feel."""

from .feeling import Feeling, Pressed, feeling_of, sensations_of
from .levels import SHORT, Levels, levels_of, running_level
from .sensation import Answer, Sensation, shares
from .thresholds import Act, Curve, Difference, Thresholds, parse_thresholds, thresholds

__all__ = [
    "SHORT",
    "Act",
    "Answer",
    "Curve",
    "Difference",
    "Feeling",
    "Levels",
    "Pressed",
    "Sensation",
    "Thresholds",
    "feeling_of",
    "levels_of",
    "parse_thresholds",
    "running_level",
    "sensations_of",
    "shares",
    "thresholds",
]
