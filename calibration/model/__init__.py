"""Rational models of responses, and the calibration that contains response and model."""

from haploop.calibration.model.calibration import Calibration, calibrate
from haploop.calibration.model.model import Model, Resonance, fit

__all__ = ["Calibration", "Model", "Resonance", "calibrate", "fit"]
