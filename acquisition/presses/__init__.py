"""Presses in a recording: segmentation, quality check, and the representative press."""

from .averaging import AverageMethod
from .filtering import high_pass
from .judging import judged
from .pressing import NAMES, LivePressing, levels_of, press_quantity
from .protocol import Protocol
from .quality import QualityCheck, accepted_presses, activation_forces
from .registration import WarpModel
from .representative import (
    Representative,
    Window,
    load_press,
    representative,
)
from .restlessness import restlessness
from .segmentation import ButtonPress, Detector, find_presses
from .segmentation_settings import SEGMENTATIONS, Segmentation, segmentation_for

__all__ = [
    "NAMES",
    "SEGMENTATIONS",
    "AverageMethod",
    "ButtonPress",
    "Detector",
    "LivePressing",
    "Protocol",
    "QualityCheck",
    "Representative",
    "Segmentation",
    "WarpModel",
    "Window",
    "accepted_presses",
    "activation_forces",
    "find_presses",
    "high_pass",
    "judged",
    "levels_of",
    "load_press",
    "press_quantity",
    "representative",
    "restlessness",
    "segmentation_for",
]
