"""Rational models of responses, and the calibration that contains response and model."""

from haploop.calibration.model.calibration import Calibration, calibrate, calibrate_keeping
from haploop.calibration.model.model import Model, Resonance, fit
from haploop.calibration.model.uncertainty import standard_deviation

__all__ = ["Calibration", "Model", "Resonance", "calibrate", "calibrate_keeping", "fit", "standard_deviation"]
