"""Streams of other programs, received by Lab Streaming Layer and recorded along."""

from .lsl import CLOCK, LslStreams
from .xdf_writer import FORMATS, XdfWriter, header

__all__ = ["CLOCK", "FORMATS", "LslStreams", "XdfWriter", "header"]
