"""Presses in a recording: segmentation, quality check, and the representative press."""

from haploop.acquisition.presses.averaging import AverageMethod
from haploop.acquisition.presses.protocol import Protocol
from haploop.acquisition.presses.quality import QualityCheck, accepted_presses, activation_forces
from haploop.acquisition.presses.registration import WarpModel
from haploop.acquisition.presses.representative import (
    Representative,
    Window,
    high_pass,
    load_press,
    representative,
)
from haploop.acquisition.presses.restlessness import restlessness
from haploop.acquisition.presses.segmentation import (
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
    "load_press",
    "representative",
    "restlessness",
    "segmentation_for",
]
