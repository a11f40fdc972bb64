"""From table to verified button: excitation, response, model, drive, check."""

from calibration.check import Check, check
from calibration.drive import Drive, drive_for, modulate
from calibration.excitation import linear_sweep
from calibration.model import Model, Resonance, fit
from calibration.record import Calibration, calibrate
from calibration.response import Response, measure_response

__all__ = [
    "Calibration",
    "Check",
    "Drive",
    "Model",
    "Resonance",
    "Response",
    "calibrate",
    "check",
    "drive_for",
    "fit",
    "linear_sweep",
    "measure_response",
    "modulate",
]
