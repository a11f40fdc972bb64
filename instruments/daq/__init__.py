"""DAQs: the role, a DAQ beside another one, and the drivers."""

from .free_running import CombinedDaq, FreeRunning
from .role import Block, Capture, Daq, Stream, StreamRequest

__all__ = ["Block", "Capture", "CombinedDaq", "Daq", "FreeRunning", "Stream", "StreamRequest"]
