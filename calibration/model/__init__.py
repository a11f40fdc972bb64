"""Rational models of responses, and the calibration that contains response and model."""

from .calibration import Calibration, calibrate, calibrate_keeping
from .even_order import even_order
from .model import Model, Resonance, fit
from .uncertainty import standard_deviation

__all__ = [
    "Calibration",
    "Model",
    "Resonance",
    "calibrate",
    "calibrate_keeping",
    "even_order",
    "fit",
    "standard_deviation",
]
