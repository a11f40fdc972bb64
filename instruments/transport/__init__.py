"""Lines of text to instruments: serial ports, sockets, VISA."""

from haploop.instruments.transport.serial_line import SerialLine, serial_trouble
from haploop.instruments.transport.text_line import Line
from haploop.instruments.transport.visa_line import VisaLine

__all__ = ["Line", "SerialLine", "VisaLine", "serial_trouble"]
