"""Lines to instruments: text over serial ports, sockets and VISA, and bytes that come by themselves."""

from .serial_line import Arrival as Arrival
from .serial_line import ByteLine as ByteLine
from .serial_line import SerialBytes as SerialBytes
from .serial_line import SerialLine as SerialLine
from .serial_line import SerialSettings as SerialSettings
from .serial_line import TapedBytes as TapedBytes
from .serial_line import close_port as close_port
from .serial_line import serial_trouble as serial_trouble
from .text_line import Line as Line
from .visa_line import VisaLine as VisaLine
