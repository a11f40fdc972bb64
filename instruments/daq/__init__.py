"""DAQs: the role, a DAQ beside another one, and the drivers."""

from .free_running import Alongside, FreeRunning
from .role import Block, Capture, Daq, Stream, StreamRequest

__all__ = ["Alongside", "Block", "Capture", "Daq", "FreeRunning", "Stream", "StreamRequest"]
