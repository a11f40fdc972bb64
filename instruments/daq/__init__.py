"""DAQ cards: the role, and its driver for NI's cards."""

from .role import Block, Capture, Daq, Stream

__all__ = ["Block", "Capture", "Daq", "Stream"]
