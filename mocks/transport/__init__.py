"""Loopback servers and lines for simulated instruments."""

from .loopback import HOST as HOST
from .loopback import Answer as Answer
from .loopback import DirectLine as DirectLine
from .loopback import Disturbance as Disturbance
from .loopback import LineServer as LineServer
from .loopback import Loopback as Loopback
from .loopback import ReplyFault as ReplyFault
from .loopback import faulty_line as faulty_line
from .pseudo_terminal import pseudo_terminal as pseudo_terminal
