"""Lines of text to instruments: serial ports, sockets, VISA."""

from .serial_line import SerialLine, serial_trouble
from .text_line import Line
from .visa_line import VisaLine

__all__ = ["Line", "SerialLine", "VisaLine", "serial_trouble"]
