"""Perception: thresholds of vibrotactile detection by act, levels above them, and what people feel."""

from .feeling import Feeling, Pressed, feeling_of, sensations_of
from .lab import LabThreshold, lab_threshold, pressing_act
from .levels import SHORT, Levels, event_levels, levels_of, running_level
from .sensation import Answer, Sensation, shares
from .thresholds import Act, Curve, Difference, Thresholds, parse_thresholds, thresholds

__all__ = [
    "SHORT",
    "Act",
    "Answer",
    "Curve",
    "Difference",
    "Feeling",
    "LabThreshold",
    "Levels",
    "Pressed",
    "Sensation",
    "Thresholds",
    "event_levels",
    "feeling_of",
    "lab_threshold",
    "levels_of",
    "parse_thresholds",
    "pressing_act",
    "running_level",
    "sensations_of",
    "shares",
    "thresholds",
]
