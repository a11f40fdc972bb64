"""Loopback servers and lines for simulated instruments."""

from haploop.mocks.transport.faulty_line import Disturbance, faulty_line
from haploop.mocks.transport.line_server import Answer, DirectLine, LineServer
from haploop.mocks.transport.loopback import HOST, Loopback, ReplyFault

__all__ = [
    "HOST",
    "Answer",
    "DirectLine",
    "Disturbance",
    "LineServer",
    "Loopback",
    "ReplyFault",
    "faulty_line",
]
