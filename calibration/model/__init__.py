"""Rational models of responses, and the calibration that contains response and model."""

from .calibration import Calibration, calibrate, calibrate_keeping
from .model import Model, Resonance, fit
from .uncertainty import standard_deviation

__all__ = ["Calibration", "Model", "Resonance", "calibrate", "calibrate_keeping", "fit", "standard_deviation"]
