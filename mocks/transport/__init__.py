"""Loopback servers and lines for simulated instruments."""

from .faulty_line import Disturbance, faulty_line
from .line_server import Answer, DirectLine, LineServer
from .loopback import HOST, Loopback, ReplyFault
from .pseudo_terminal import pseudo_terminal

__all__ = [
    "HOST",
    "Answer",
    "DirectLine",
    "Disturbance",
    "LineServer",
    "Loopback",
    "ReplyFault",
    "faulty_line",
    "pseudo_terminal",
]
