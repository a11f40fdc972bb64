"""Loopback servers and lines for simulated instruments."""

from .faulty_line import Disturbance as Disturbance
from .faulty_line import faulty_line as faulty_line
from .line_server import Answer as Answer
from .line_server import DirectLine as DirectLine
from .line_server import LineServer as LineServer
from .loopback import HOST as HOST
from .loopback import Loopback as Loopback
from .loopback import ReplyFault as ReplyFault
from .pseudo_terminal import pseudo_terminal as pseudo_terminal
