"""Wires to simulated instruments: servers over TCP, lines of text, and a proxy that disturbs answers.

A program that opens a serial port by its path gets a device file in front of one.
"""

from __future__ import annotations

import math
import os
import re
import select
import socket
import socketserver
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Literal

from ..base.errors import ConfigurationError, InstrumentError
from ..base.threads import Closing, Flag

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


# Access to a simulated instrument that speaks lines of text, over TCP or by calls in the same process.

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


# TCP proxy between a real driver and a wire, which disturbs answers.
#
# It is independent of the protocol: the client's last message is the request, and the next data from the
# wire is its answer. The head of an HTTP answer stays intact, so that a fault tests the driver's handling of
# a wrong body rather than of a wrong head.

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


_COPIES = 0.1
"""Interval (s) at which a pseudo-terminal looks for its end."""


@contextmanager
def pseudo_terminal(host: str, port: int) -> Iterator[str]:
    """Serve a wire at a device file; yield its path. Raises ConfigurationError on Windows, which has none."""
    if os.name == "nt":
        raise ConfigurationError(
            "Windows has no pseudo-terminals: open the socket:// address, or run the program by this command."
        )
    import tty  # noqa: PLC0415

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    ended = Flag()
    with socket.create_connection((host, port)) as link:
        thread = threading.Thread(target=_copy, args=(ours, link, ended), daemon=True)
        thread.start()
        try:
            # `theirs` stays open here: without anybody at it, reading `ours` fails.
            yield os.ttyname(theirs)
        finally:
            ended.set()
            thread.join()
            os.close(theirs)
            os.close(ours)


def _copy(terminal: int, link: socket.socket, ended: Flag) -> None:
    """Copy bytes in both directions."""
    both: list[int | socket.socket] = [terminal, link]
    with suppress(OSError):
        while not ended.is_set():
            ready, _, _ = select.select(both, [], [], _COPIES)
            if terminal in ready:
                link.sendall(os.read(terminal, 1 << 16))
            if link in ready:
                answer = link.recv(1 << 16)
                if not answer:
                    return
                os.write(terminal, answer)
