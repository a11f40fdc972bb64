"""Rational models of responses, and the calibration that contains response and model."""

from .calibrating import calibrate, calibrate_keeping, even_order
from .calibration import Calibration, ChannelScatter, calibration_of, load_calibrations
from .channel_scatter import ChannelChange, channel_change, with_scatter
from .drift import Drift, apart, mode_deviations, pole_slopes
from .finger import GROWS, Finger, at_force, under_finger
from .finger_finding import PlateModes
from .finger_measuring import calibrate_finger
from .model import Model, Resonance, fit
from .uncertainty import standard_deviation

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
