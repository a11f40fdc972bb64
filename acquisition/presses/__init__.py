"""Presses in a recording: segmentation, quality check, and the representative press."""

from .averaging import AverageMethod
from .judging import judged
from .protocol import Protocol
from .quality import QualityCheck, accepted_presses, activation_forces
from .registration import WarpModel
from .representative import (
    Representative,
    Window,
    high_pass,
    load_press,
    representative,
)
from .restlessness import restlessness
from .segmentation import (
    SEGMENTATIONS,
    ButtonPress,
    Detector,
    Segmentation,
    find_presses,
    segmentation_for,
)

__all__ = [
    "SEGMENTATIONS",
    "AverageMethod",
    "ButtonPress",
    "Detector",
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
    "load_press",
    "representative",
    "restlessness",
    "segmentation_for",
]
