"""From volts to presses: streaming, recording files, segmentation, and the representative press."""

from acquisition.judging import accepted_presses
from acquisition.layout import Event, PressVerdict
from acquisition.presses import SEGMENTATIONS, ButtonPress, Segmentation, find_presses, segmentation_for
from acquisition.protocol import Protocol
from acquisition.recorder import record
from acquisition.recording import Recording
from acquisition.recovery import recover
from acquisition.registration import WarpModel
from acquisition.represent import Representative, Window, high_pass, representative
from acquisition.scan import verify
from acquisition.study import Study, StudyProgress, load_study, run_study

__all__ = [
    "SEGMENTATIONS",
    "ButtonPress",
    "Event",
    "PressVerdict",
    "Protocol",
    "Recording",
    "Representative",
    "Segmentation",
    "Study",
    "StudyProgress",
    "WarpModel",
    "Window",
    "accepted_presses",
    "find_presses",
    "high_pass",
    "load_study",
    "record",
    "recover",
    "representative",
    "run_study",
    "segmentation_for",
    "verify",
]
