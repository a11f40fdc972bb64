"""Keeping a calibration true: history, drift, sensor health, recalibration."""

from .drift import PlaceMetrics
from .history import Generation, History
from .recalibration import (
    Outcome,
    activate,
    adopt,
    buttons_of,
    calibrations_of,
    recalibrate,
)

__all__ = [
    "Generation",
    "History",
    "Outcome",
    "PlaceMetrics",
    "activate",
    "adopt",
    "buttons_of",
    "calibrations_of",
    "recalibrate",
]
