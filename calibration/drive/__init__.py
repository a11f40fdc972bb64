"""Drives: inversion, the drive's waveforms, the check, learning, the digital button."""

from ..band import BAND
from .actuation import drift_change
from .agreement import SharedPower, told_by_noise
from .button import DigitalButton, build_button, button_under_finger, check_feeling, play_button
from .check import TOLERANCE, check, resolved
from .checked import Check
from .drive import Drive, drive_for
from .learning import Iteration, Learning, learn
from .loudness import ButtonPlan, Loudness, Offer, Offers, offered, plan_button, trade_for
from .planning import STEADY, TradeOff
from .playing import judged_to
from .pressed import PressedDrives, check_under_finger, pressed_drives
from .targets import BEFORE, NOWHERE, Method, OtherPoint, Wanted, activation_time, load_elsewhere, modulate
from .verdict import worst

__all__ = [
    "BAND",
    "BEFORE",
    "NOWHERE",
    "STEADY",
    "TOLERANCE",
    "ButtonPlan",
    "Check",
    "DigitalButton",
    "Drive",
    "Iteration",
    "Learning",
    "Loudness",
    "Method",
    "Offer",
    "Offers",
    "OtherPoint",
    "PressedDrives",
    "SharedPower",
    "TradeOff",
    "Wanted",
    "activation_time",
    "build_button",
    "button_under_finger",
    "check",
    "check_feeling",
    "check_under_finger",
    "drift_change",
    "drive_for",
    "judged_to",
    "learn",
    "load_elsewhere",
    "modulate",
    "offered",
    "plan_button",
    "play_button",
    "pressed_drives",
    "resolved",
    "told_by_noise",
    "trade_for",
    "worst",
]
