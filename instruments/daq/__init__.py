"""DAQ cards: the role, and its driver for NI's cards."""

from haploop.instruments.daq.role import Block, Capture, Daq, Stream

__all__ = ["Block", "Capture", "Daq", "Stream"]
