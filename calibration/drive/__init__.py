"""Drives: inversion, the drive's waveform, the check, learning, the digital button."""

from haploop.calibration.drive.button import DigitalButton, build_button, play_button
from haploop.calibration.drive.check import Check, check
from haploop.calibration.drive.drive import BAND, Drive, Method, drive_for, modulate
from haploop.calibration.drive.feeling import check_feeling
from haploop.calibration.drive.learning import Iteration, Learning, learn
from haploop.calibration.drive.paper_baseline import paper_drive

__all__ = [
    "BAND",
    "Check",
    "DigitalButton",
    "Drive",
    "Iteration",
    "Learning",
    "Method",
    "build_button",
    "check",
    "check_feeling",
    "drive_for",
    "learn",
    "modulate",
    "paper_drive",
    "play_button",
]
