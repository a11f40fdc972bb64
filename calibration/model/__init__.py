"""Rational models of responses, and the calibration that contains response and model."""

from .calibrating import calibrate, calibrate_keeping
from .calibration import Calibration
from .drift import Drift, mode_deviations
from .even_order import even_order
from .model import Model, Resonance, fit
from .uncertainty import standard_deviation

__all__ = [
    "Calibration",
    "Drift",
    "Model",
    "Resonance",
    "calibrate",
    "calibrate_keeping",
    "even_order",
    "fit",
    "mode_deviations",
    "standard_deviation",
]
