"""Rational models of responses, and the calibration that contains response and model."""

from haploop.calibration.model.calibration import Calibration, calibrate
from haploop.calibration.model.model import Model, Resonance, fit
from haploop.calibration.model.uncertainty import standard_deviation

__all__ = ["Calibration", "Model", "Resonance", "calibrate", "fit", "standard_deviation"]
