"""Access to a simulated instrument that speaks lines of text, over TCP or by calls in the same process."""

from __future__ import annotations

import re
import socket
import threading
from collections import deque
from collections.abc import Callable, Sequence

from ...base.errors import InstrumentError
from .loopback import Loopback, ReplyFault

Answer = Callable[[str], Sequence[str]]
"""An instrument: takes a line (without its end) and returns the lines of its answer."""

_LONGEST_COMMAND = 1 << 25


_BLOCK = re.compile(rb"[, ]#([1-9])(\d*)")
"""Beginning of a block of binary data: the number of digits of its length, and those that have come."""


def _end_of_line(pending: bytearray) -> tuple[int | None, int]:
    """Where the first line ends, outside of blocks of binary data; None, and how many bytes it needs."""
    at = 0
    while True:
        end = pending.find(b"\n", at)
        block = _BLOCK.search(pending, at, end if end >= 0 else len(pending))
        if block is None:
            return (end if end >= 0 else None), len(pending) + 1
        digits = int(block[1])
        length = bytes(pending[block.start(2) : block.start(2) + digits])
        if len(length) < digits:
            return None, len(pending) + 1
        if not length.isdigit():
            return (end if end >= 0 else None), len(pending) + 1
        at = block.start(2) + digits + int(length)
        if at > len(pending):
            return None, at + 1


class DirectLine:
    """A `Line` to an instrument in the same process, for a twin's driver."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._replies: deque[str] = deque()

    def send(self, text: str) -> None:
        """See `Line.send`."""
        self._replies = deque(self._answer(text))

    def receive(self, asked: str) -> str:
        """See `Line.receive`. Raises InstrumentError at once when there is no answer."""
        if not self._replies:
            raise InstrumentError(f"The twin did not answer {asked!r}: it does not know that command.")
        return self._replies.popleft()

    def close(self) -> None:
        """See `Line.close`."""


class LineServer(Loopback):
    """Server of one instrument, one command at a time, for any number of clients."""

    def __init__(self, answer: Answer, port: int = 0) -> None:
        self.faults: list[ReplyFault] = []
        self._answer = answer
        self._turn = threading.Lock()
        super().__init__(self._lines, port)

    def _lines(self, link: socket.socket) -> None:
        pending = bytearray()
        wanted = 1
        while (more := link.recv(1 << 16)) and len(pending) < _LONGEST_COMMAND:
            pending += more
            while len(pending) >= wanted:
                end, wanted = _end_of_line(pending)
                if end is None:
                    break
                command = bytes(pending[:end]).decode("latin-1").strip("\r\n")
                del pending[: end + 1]
                wanted = 1
                if command.strip() and not self._reply(link, command if "#" in command else command.strip()):
                    return

    def _reply(self, link: socket.socket, command: str) -> bool:
        """Answer one command; return False when a fault ends the connection."""
        with self._turn:
            reply = "".join(f"{line}\n" for line in self._answer(command)).encode("latin-1")
        fault = next((f for f in self.faults if f.fires(command)), None)
        if fault is None:
            link.sendall(reply)
            return True
        if fault.kind == "terminator":
            reply = reply.replace(b"\n", b"\r")
        if fault.kind == "garbled":
            # As with a wrong baud rate, the text is lost. Its end survives: the harder case for a driver.
            link.sendall(bytes(b if b == 10 else b ^ 0xA5 for b in reply))
            return True
        return fault.send(link, reply, self.closing)
