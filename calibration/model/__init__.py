"""Rational models of responses, and the calibration that contains response and model."""

from .calibration import (
    Calibration,
    ChannelScatter,
    calibrate,
    calibrate_keeping,
    calibration_of,
    even_order,
    load_calibrations,
)
from .drift import ChannelChange, Drift, apart, channel_change, mode_deviations, pole_slopes, with_scatter
from .finger import GROWS, Finger, at_force, under_finger
from .finger_finding import PlateModes
from .finger_measuring import calibrate_finger
from .model import Model, Resonance, fit, standard_deviation

__all__ = [
    "GROWS",
    "Calibration",
    "ChannelChange",
    "ChannelScatter",
    "Drift",
    "Finger",
    "Model",
    "PlateModes",
    "Resonance",
    "apart",
    "at_force",
    "calibrate",
    "calibrate_finger",
    "calibrate_keeping",
    "calibration_of",
    "channel_change",
    "even_order",
    "fit",
    "load_calibrations",
    "mode_deviations",
    "pole_slopes",
    "standard_deviation",
    "under_finger",
    "with_scatter",
]
