"""From table to verified button: excitation, response, model, drive, check."""

from calibration.button import DigitalButton, build_button, play_button
from calibration.check import Check, check
from calibration.drive import Drive, drive_for, modulate
from calibration.excitation import LinearSweep, Multisine, linear_sweep, plan_excitation
from calibration.learning import Iteration, Learning, learn
from calibration.map import VibrationMap
from calibration.mapping import map_plan, measure_map
from calibration.model import Model, Resonance, fit
from calibration.paper_way import paper_drive
from calibration.record import Calibration, calibrate
from calibration.response import Response, measure_response, quick_response
from calibration.uff import read_uff, write_uff

__all__ = [
    "Calibration",
    "Check",
    "DigitalButton",
    "Drive",
    "Iteration",
    "Learning",
    "LinearSweep",
    "Model",
    "Multisine",
    "Resonance",
    "Response",
    "VibrationMap",
    "build_button",
    "calibrate",
    "check",
    "drive_for",
    "fit",
    "learn",
    "linear_sweep",
    "map_plan",
    "measure_map",
    "measure_response",
    "modulate",
    "paper_drive",
    "plan_excitation",
    "play_button",
    "quick_response",
    "read_uff",
    "write_uff",
]
