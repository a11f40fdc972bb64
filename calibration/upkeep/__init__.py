"""Keeping a calibration true: history, drift, sensor health, recalibration."""

from haploop.calibration.upkeep.drift import PlaceMetrics
from haploop.calibration.upkeep.history import Generation, History
from haploop.calibration.upkeep.recalibration import (
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
