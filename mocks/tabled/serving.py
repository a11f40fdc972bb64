"""Instruments of tables, served on loopback under the names by which a program opens them."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler
from urllib.parse import urlsplit

from ...base.errors import ConfigurationError
from ..transport import Loopback, pseudo_terminal
from .instrument import Instrument

_LONGEST = 1 << 20
"""Bytes of a command (a bound)."""


class Lines(Loopback):
    """An instrument on a socket or a serial line: commands with an end."""

    def __init__(self, instrument: Instrument) -> None:
        self._instrument = instrument
        super().__init__(self._serve)

    def _serve(self, link: socket.socket) -> None:
        end = self._instrument.table.end.encode("latin-1")
        pending = b""
        while (more := link.recv(1 << 16)) and len(pending) < _LONGEST:
            pending += more
            while end in pending:
                line, pending = pending.split(end, 1)
                command = line.decode("latin-1")
                # A program may end a line by more than is looked for.
                if not self._reply(link, command.strip("\r\n") if end == b"\n" else command, end):
                    return

    def _reply(self, link: socket.socket, command: str, end: bytes) -> bool:
        answer = self._instrument.answer(command)
        answer = self._instrument.table.error if answer is None else answer
        reply = answer.encode("latin-1") + end if answer else b""
        fault = next((one for one in self._instrument.faults if one.fires(command)), None)
        if fault is None:
            link.sendall(reply)
            return True
        return fault.send(link, reply, self.closing)


class Pages(Loopback):
    """An instrument behind HTTP: the command is "GET /volt?x=1", or "PUT /volt 3" with a body."""

    def __init__(self, instrument: Instrument) -> None:
        super().__init__(self._serve)
        wire = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def handle_one_request(self) -> None:
                self.raw_requestline = self.rfile.readline(1 << 16)
                if not self.raw_requestline or not self.parse_request():
                    self.close_connection = True
                    return
                body = self.rfile.read(min(int(self.headers.get("Content-Length") or 0), _LONGEST))
                words = [self.command, self.path, *([body.decode("latin-1")] if body else [])]
                answer = instrument.answer(" ".join(words))
                status = "200 OK" if answer is not None else "404 Not Found"
                text = (instrument.table.error or "" if answer is None else answer).encode("utf-8")
                kind = "application/json" if text[:1] in (b"{", b"[") else "text/plain; charset=utf-8"
                head = f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(text)}\r\n\r\n"
                fault = next((one for one in instrument.faults if one.fires(" ".join(words))), None)
                whole = head.encode() + text
                if fault is None:
                    self.connection.sendall(whole)
                elif not fault.send(self.connection, whole, wire.closing, spare=len(head)):
                    self.close_connection = True

        self._handler = Handler

    def _serve(self, link: socket.socket) -> None:
        self._handler(link, ("127.0.0.1", 0), None)  # type: ignore[arg-type]  # it needs no server


@dataclass(frozen=True)
class Served:
    """What stands for each name, by what opens it."""

    serial: dict[str, str] = field(default_factory=dict)
    visa: dict[str, str] = field(default_factory=dict)
    hosts: dict[str, str] = field(default_factory=dict)
    """By "host:port"."""
    ports: list[int] = field(default_factory=list)
    """TCP ports at which something is served."""
    wires: dict[str, Lines | Pages] = field(default_factory=dict)
    """By name."""


@contextmanager
def serving(instruments: Mapping[str, Instrument]) -> Iterator[Served]:
    """Serve instruments as long as the context lasts.

    A name is a serial port ("COM3", "/dev/ttyUSB0"), a VISA resource ("GPIB0::5::INSTR"), an address of HTTP
    ("http://192.0.2.20") or of a socket ("192.0.2.20:5025"). Raises ConfigurationError for another.
    """
    found = Served()
    with ExitStack() as stack:
        for name, instrument in instruments.items():
            add(stack, found, name, instrument)
        yield found


def add(stack: ExitStack, found: Served, name: str, instrument: Instrument) -> Lines | Pages:
    """Serve one more instrument, until `stack` is closed. Raises ConfigurationError."""
    if name.lower() in (other.lower() for other in found.wires):
        raise ConfigurationError(f"{name!r} has an instrument already: name another port or address.")
    place = _place(name)
    wire: Lines | Pages = (Pages if "://" in name else Lines)(instrument)
    stack.callback(wire.close)
    if place:
        found.hosts[place] = wire.address
    elif "::" in name:
        found.visa[name] = f"TCPIP::127.0.0.1::{wire.port}::SOCKET"
    elif name.strip() and not any(c.isspace() for c in name):
        port = f"socket://{wire.address}"
        if os.name != "nt":
            port = stack.enter_context(pseudo_terminal("127.0.0.1", wire.port))
        found.serial[name] = port
    else:
        raise ConfigurationError(f"{json.dumps(name)} is no name of a port, a VISA resource or an address.")
    found.ports.append(wire.port)
    found.wires[name] = wire
    return wire


def _place(name: str) -> str:
    """Host and port of an address, "192.0.2.20:80"; "" for another name. Raises ConfigurationError."""
    if "://" not in name and not ("::" not in name and name.rpartition(":")[2].isdecimal() and ":" in name):
        return ""
    try:
        parts = urlsplit(name if "://" in name else f"//{name}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or parts.scheme not in ("http", ""):
        raise ConfigurationError(
            f"{name!r} cannot be served: an address is http://HOST, http://HOST:PORT or HOST:PORT, with a "
            "port up to 65535."
        )
    return f"{host}:{port or 80}"
