"""Base of every wire over TCP: serves on loopback, injects faults, stops cleanly."""

from __future__ import annotations

import math
import os
import socket
import socketserver
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from ...base.closing import Closing
from ...base.flag import Flag

HOST = "127.0.0.1"
"""The only address on which simulated instruments listen: see `Loopback`."""

_LOOK = 0.02
"""Interval (s of real time) at which the server checks for a request to stop."""


@dataclass
class ReplyFault:
    """A misbehaviour of an instrument or of the line to it, added to the `faults` of a wire.

    It fires on requests that contain `asked`: it skips the first `after` of them, and then fires `times`
    times. The request is executed all the same, except with "not found" (a hub's answer for an unplugged
    module) and "password".
    """

    kind: Literal[
        "silence",
        "delay",
        "drip",
        "garbled",
        "truncated",
        "disconnect",
        "terminator",
        "not found",
        "password",
    ]
    asked: str = ""
    after: int = 0
    times: float = math.inf
    delay: float = 0.05
    """Delay in real time (s): before the reply with "delay", between its bytes with "drip"."""
    seen: int = 0
    fired: int = 0

    def fires(self, request: str) -> bool:
        """Return True when it fires on this request, and count it."""
        if self.asked not in request:
            return False
        self.seen += 1
        fires = self.seen > self.after and self.fired < self.times
        self.fired += fires
        return fires

    def send(self, link: socket.socket, reply: bytes, closing: Flag, spare: int = 0) -> bool:
        """Send a reply as this fault changes it, with the first `spare` bytes intact.

        Returns True when the connection may go on. For protocol-specific kinds the reply is sent
        unchanged, because the wire has already changed it.
        """
        head, body = reply[:spare], reply[spare:]
        match self.kind:
            case "silence":
                with suppress(OSError):
                    link.recv(1)  # Returns when the client gives up or the wire is closed.
                return False
            case "disconnect":
                return False
            case "truncated":
                link.sendall(head + body[: len(body) // 2])
                return False
            case "garbled":
                link.sendall(head + bytes(byte ^ 0x5A for byte in body))
            case "drip":
                for position in range(len(reply)):
                    link.sendall(reply[position : position + 1])
                    if closing.wait(self.delay):
                        return False
            case "delay":
                closing.wait(self.delay)
                link.sendall(reply)
            case _:
                link.sendall(reply)
        return True


class Loopback(Closing):
    """TCP server that calls `serve(link)` in a thread for each connection, and closes it on return.

    An OSError in `serve` means that the client left or that the server is closing; it is ignored. The
    server listens on this computer only, because the protocols have no secure password; for access from
    another computer, forward the port by ssh.
    """

    def __init__(self, serve: Callable[[socket.socket], None], port: int = 0) -> None:
        self.closing = Flag()
        """Set when the server stops; every wait in `serve` must wait on this event."""
        self._server = _Server((HOST, port), serve)
        self.port: int = self._server.server_address[1]
        self.address = f"{HOST}:{self.port}"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(_LOOK,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and cut every connection, like a killed program. May be called again."""
        if not self.closing.is_set():
            self.closing.set()
            self._server.shutdown()
            self._thread.join()
            self._server.cut()
            self._server.server_close()


class _Server(socketserver.ThreadingTCPServer):
    request_queue_size = 64
    # A port that has just been served is free again; on Windows the same word would share one that is in use.
    allow_reuse_address = os.name != "nt"

    def __init__(self, address: tuple[str, int], serve: Callable[[socket.socket], None]) -> None:
        self._serve = serve
        self._links: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._guard = threading.Lock()
        super().__init__(address, socketserver.BaseRequestHandler)

    def process_request(self, request: socket.socket, client_address: object) -> None:  # type: ignore[override]
        with self._guard:
            self._links.add(request)
        # Daemons, which no end of a program waits for: they serve its rig until that is closed.
        thread = threading.Thread(
            target=self.process_request_thread, args=(request, client_address), daemon=True
        )
        self._threads = [other for other in self._threads if other.is_alive()] + [thread]
        thread.start()

    def server_close(self) -> None:
        socketserver.TCPServer.server_close(self)
        for thread in self._threads:
            thread.join()

    def finish_request(self, request: socket.socket, client_address: object) -> None:  # type: ignore[override]
        request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with suppress(OSError):
            self._serve(request)

    def shutdown_request(self, request: socket.socket) -> None:  # type: ignore[override]
        with self._guard:
            self._links.discard(request)
        super().shutdown_request(request)

    def cut(self) -> None:
        """Shut every connection down, which wakes the threads that wait for their clients."""
        with self._guard:
            for link in self._links:
                with suppress(OSError):
                    link.shutdown(socket.SHUT_RDWR)
