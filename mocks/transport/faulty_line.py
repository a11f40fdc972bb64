"""A line between a real driver and a wire that disturbs answers: it stands between any two TCP ends.

It knows no protocol. What the client has sent last is the request, what comes next is its answer. Of
an answer in HTTP the head is left whole, because no line garbles the one and spares the other's
length: what is to be seen is what a driver makes of a wrong body.
"""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress

from haploop.mocks.transport.loopback import Loopback, ReplyFault

__all__ = ["Disturbance", "faulty_line"]

Disturbance = Callable[[str], ReplyFault | None]
"""How the answer to a request is disturbed; None leaves it whole."""

_PLACE = re.compile(r"(?P<host>127\.0\.0\.1)(?P<between>:+)(?P<port>\d+)")


@contextmanager
def faulty_line(address: Mapping[str, object], disturbance: Disturbance) -> Iterator[dict[str, object]]:
    """A wire's address (settings of its driver), led through a line that disturbs answers."""
    found = [(key, match) for key, value in address.items() if (match := _PLACE.search(str(value)))]
    (key, match), *_ = found
    line = _Line(int(match["port"]), disturbance)
    with Loopback(line.serve) as loopback:
        line.closing = loopback.closing
        place = f"{match['host']}{match['between']}{loopback.port}"
        yield {**address, key: str(address[key]).replace(match[0], place)}


class _Line:
    def __init__(self, port: int, disturbance: Disturbance) -> None:
        self.closing = threading.Event()
        self._port, self._disturbance = port, disturbance

    def serve(self, client: socket.socket) -> None:
        """One connection: requests go on as they are, answers as the faults would have them."""
        with socket.create_connection(("127.0.0.1", self._port)) as server:
            current: list[ReplyFault | None] = [None]
            back = threading.Thread(target=self._answers, args=(server, client, current))
            back.start()
            try:
                while request := client.recv(1 << 16):
                    current[0] = self._disturbance(request.decode("latin-1"))
                    server.sendall(request)
            finally:
                for end in (server, client):
                    with suppress(OSError):
                        end.shutdown(socket.SHUT_RDWR)
                back.join()

    def _answers(
        self, server: socket.socket, client: socket.socket, current: list[ReplyFault | None]
    ) -> None:
        with suppress(OSError):
            while answer := server.recv(1 << 16):
                fault = current[0]
                if fault is None:
                    client.sendall(answer)
                elif not self._disturbed(fault, client, answer):
                    break
            if current[0] is not None and current[0].kind == "silence":
                return  # The far end has hung up, as in HTTP, and the client still waits.
        # The far end has gone: the other direction waits for the client no longer.
        for end in (server, client):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def _disturbed(self, fault: ReplyFault, client: socket.socket, answer: bytes) -> bool:
        """Send an answer with a fault; False when the connection ends with it."""
        if fault.kind == "silence":
            return True
        head = answer.find(b"\r\n\r\n") + 4 if answer.startswith(b"HTTP/") else 0
        return fault.send(client, answer, self.closing, spare=head)
