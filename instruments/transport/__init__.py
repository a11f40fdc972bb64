"""Lines to instruments: text over serial ports, sockets and VISA, and bytes that come by themselves."""

from .byte_line import Arrival, ByteLine, SerialBytes, TapedBytes
from .serial_line import SerialLine, SerialSettings, serial_trouble
from .text_line import Line
from .visa_line import VisaLine

__all__ = [
    "Arrival",
    "ByteLine",
    "Line",
    "SerialBytes",
    "SerialLine",
    "SerialSettings",
    "TapedBytes",
    "VisaLine",
    "serial_trouble",
]
