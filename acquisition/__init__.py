"""From volts to presses: streaming, recording files, segmentation, and the representative press."""

from acquisition.averaging import WarpModel
from acquisition.layout import Event
from acquisition.presses import ButtonPress, Segmentation, find_presses
from acquisition.recorder import record
from acquisition.recording import Recording
from acquisition.represent import Representative, Window, high_pass, representative
from acquisition.scan import recover, verify

__all__ = [
    "ButtonPress",
    "Event",
    "Recording",
    "Representative",
    "Segmentation",
    "WarpModel",
    "Window",
    "find_presses",
    "high_pass",
    "record",
    "recover",
    "representative",
    "verify",
]
