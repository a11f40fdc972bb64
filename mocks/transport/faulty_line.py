"""TCP proxy between a real driver and a wire, which disturbs answers.

It is independent of the protocol: the client's last message is the request, and the next data from the
wire is its answer. The head of an HTTP answer stays intact, so that a fault tests the driver's handling of
a wrong body rather than of a wrong head.
"""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress

from ...base.flag import Flag
from .loopback import Loopback, ReplyFault

Disturbance = Callable[[str], ReplyFault | None]
"""Return the fault of the answer to a request; None leaves the answer intact."""

_PLACE = re.compile(r"(?P<host>127\.0\.0\.1)(?P<between>:+)(?P<port>\d+)")


@contextmanager
def faulty_line(
    address: Mapping[str, object], disturbance: Disturbance, port: int = 0
) -> Iterator[dict[str, object]]:
    """Serve a line that disturbs answers; yield a wire's `address` (driver settings) redirected to it.

    `port` is the line's own, 0 for a free one.
    """
    found = [(key, match) for key, value in address.items() if (match := _PLACE.search(str(value)))]
    (key, match), *_ = found
    line = _Line(int(match["port"]), disturbance)
    with Loopback(line.serve, port) as loopback:
        line.closing = loopback.closing
        place = f"{match['host']}{match['between']}{loopback.port}"
        yield {**address, key: str(address[key]).replace(match[0], place)}


class _Line:
    def __init__(self, port: int, disturbance: Disturbance) -> None:
        self.closing = Flag()
        self._port, self._disturbance = port, disturbance

    def serve(self, client: socket.socket) -> None:
        """Serve one connection: pass requests on unchanged, and answers as the faults change them."""
        with socket.create_connection(("127.0.0.1", self._port)) as server:
            current: list[ReplyFault | None] = [None]
            back = threading.Thread(target=self._answers, args=(server, client, current), daemon=True)
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
                return  # The server has hung up, as in HTTP; the client is left waiting.
        # The server has gone: end the other direction's wait for the client.
        for end in (server, client):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def _disturbed(self, fault: ReplyFault, client: socket.socket, answer: bytes) -> bool:
        """Send an answer with a fault; return False when the fault ends the connection."""
        if fault.kind == "silence":
            return True
        head = answer.find(b"\r\n\r\n") + 4 if answer.startswith(b"HTTP/") else 0
        return fault.send(client, answer, self.closing, spare=head)
