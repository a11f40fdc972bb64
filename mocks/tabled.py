"""Any instrument from a table of commands and answers: on a serial line, by VISA, HTTP or a socket."""

from __future__ import annotations

import json
import os
import re
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

from pydantic import StrictBool, StrictFloat, StrictInt, StrictStr

from ..base.bounded import Strict
from ..base.errors import ConfigurationError
from ..base.validation import key_lines, parse_toml, place, read_text, validate
from ..base.wording import did_you_mean
from ..nidaqmx_twin.redirect import redirected
from .transport import Loopback, ReplyFault, pseudo_terminal

# An instrument that a table describes: which command it answers how, and what it keeps.
#
#     [answers]
#     "*IDN?" = "ACME,PSU,1,1.0"
#     "VOLT {volt}" = ""              # sets the state, and is not answered
#     "VOLT?" = "{volt:.3f}"
#     [state]
#     volt = { value = 0.0, min = 0, max = 30 }
#
# `{name}` in a command is a value of the state's kind; in an answer it is the state, in Python's format.
# Other braces are text. A list of answers is given in turn, its last one again and again.

Value = bool | int | float | str

_PLACE = re.compile(r"\{([A-Za-z_]\w*)(?::([^{}]*))?\}")
_SWITCH = {"1": True, "ON": True, "TRUE": True, "0": False, "OFF": False, "FALSE": False}


class State(Strict):
    """A value that the instrument keeps, and its limits."""

    value: StrictBool | StrictInt | StrictFloat | StrictStr
    min: StrictInt | StrictFloat | None = None
    max: StrictInt | StrictFloat | None = None


class Table(Strict):
    """What an instrument answers. See the module."""

    answers: dict[str, str | list[str]]
    state: Mapping[str, StrictBool | StrictInt | StrictFloat | StrictStr | State] = {}
    error: str | None = None
    """Answer to a command that the table does not have, and to a value that does not fit; without it, none,
    and the command is one of `Instrument.unknown`."""
    end: str = "\n"
    """End of a command and of an answer, on serial lines and sockets."""


class Instrument:
    """An instrument of a table. Any thread may call it."""

    def __init__(self, table: Table, place: str = "the table") -> None:
        """Raises ConfigurationError for a table that contradicts itself."""
        self.table = table
        self.received: list[str] = []
        """Every command, in the order of its coming, without its end."""
        self.unknown: list[str] = []
        """Commands that were not understood."""
        self.state: dict[str, Value] = {}
        """What it keeps now; a test may change it."""
        self.faults: list[ReplyFault] = []
        """Faults of its line."""
        self._limits: dict[str, State] = {}
        self._turns: dict[str, int] = {}
        self._lock = threading.Lock()
        for name, kept in table.state.items():
            one = kept if isinstance(kept, State) else State(value=kept)
            self.state[name], self._limits[name] = one.value, one
        self._commands = {_pattern(command, self.state, place): command for command in table.answers}
        for command, answers in table.answers.items():
            for answer in [answers] if isinstance(answers, str) else answers:
                self._said(answer, f"{place}: the answer to {command!r}")
            if not answers and not isinstance(answers, str):
                raise ConfigurationError(f'{place}: {command!r} has no answer: write "" for none.')

    def answer(self, command: str) -> str | None:
        """Return the answer to a command: empty for none, None for one that is not understood."""
        with self._lock:
            self.received.append(command)
            for pattern, known in self._commands.items():
                found = pattern.fullmatch(command.strip())
                if found is not None:
                    new = {name: _value(text, self._limits[name]) for name, text in found.groupdict().items()}
                    if None in new.values():
                        break
                    self.state.update({name: value for name, value in new.items() if value is not None})
                    return self._said(self._next(known), known)
            self.unknown.append(command)
            return None

    def _next(self, command: str) -> str:
        answers = self.table.answers[command]
        if isinstance(answers, str):
            return answers
        turn = self._turns.get(command, 0)
        self._turns[command] = turn + 1
        return answers[min(turn, len(answers) - 1)]

    def _said(self, answer: str, place: str) -> str:
        def value(found: re.Match[str]) -> str:
            if found[1] not in self.state:
                hint = did_you_mean(found[1], self.state, "the state has")
                raise ConfigurationError(f"{place} names {found[1]!r}, which is no state; {hint}")
            try:
                return format(self.state[found[1]], found[2] or "")
            except ValueError as error:
                raise ConfigurationError(f"{place}: {found[0]} does not fit the state ({error}).") from None

        return _PLACE.sub(value, answer)


def _pattern(command: str, state: Mapping[str, Value], place: str) -> re.Pattern[str]:
    """What matches a command, with a group for each value in it."""
    parts, at, names = [], 0, []
    for found in _PLACE.finditer(command):
        if found[1] not in state or found[1] in names:
            hint = did_you_mean(found[1], state, "the state has")
            why = "twice" if found[1] in names else f"which is no state; {hint}"
            raise ConfigurationError(f"{place}: the command {command!r} names {found[1]!r}, {why}")
        names.append(found[1])
        parts += [re.escape(command[at : found.start()]), f"(?P<{found[1]}>.+?)"]
        at = found.end()
    return re.compile("".join([*parts, re.escape(command[at:])]), re.DOTALL)


def _value(text: str, kept: State) -> Value | None:
    """The value that a text says, of the kind that is kept; None for one that does not fit."""
    value: Value | None
    try:
        match kept.value:
            case bool():
                return _SWITCH.get(text.strip().upper())
            case int():
                value = int(text)
            case float():
                value = float(text)
            case _:
                return text
    except ValueError:
        return None
    fits = (kept.min is None or value >= kept.min) and (kept.max is None or value <= kept.max)
    return value if fits else None


def read_table(path: Path) -> Table:
    """Read a table. Raises ConfigurationError, which names the file, the line and the key."""
    text = read_text(path, f"There is no table {path}.")
    raw = parse_toml(text, path)
    table = validate(Table, raw, partial(place, ((str(path), key_lines(text)),)))
    Instrument(table, str(path))
    return table


def table_of(
    answers: Mapping[str, str | Sequence[str]] | str | Path, folder: Path, **more: Any
) -> tuple[Table, str]:
    """The table that a test writes, or that a file in `folder` holds, and where it stands."""
    if isinstance(answers, str | Path):
        path = folder / answers
        if more:
            raise ConfigurationError(f"{path} has all of the table: leave out {', '.join(more)}.")
        return read_table(path), str(path)
    told = {one: said if isinstance(said, str) else list(said) for one, said in answers.items()}
    return validate(Table, {"answers": told, **more}, "the table"), "the table"


# Instruments of tables, served on loopback under the names by which a program opens them.

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


# Instruments of tables in a program's own process, for its tests.


class InstrumentTwins:
    """A context in which pyserial, PyVISA and sockets find instruments of tables.

    pyserial and PyVISA open no other.
    """

    def __init__(self, folder: Path) -> None:
        """Files of tables lie in `folder`."""
        self._folder = folder
        self._stack, self._redirection = ExitStack(), ExitStack()
        self._found = Served()
        self._instruments: dict[str, Instrument] = {}

    def serve(
        self, name: str, answers: Mapping[str, str | Sequence[str]] | str | Path, **more: Any
    ) -> Instrument:
        """Serve an instrument under a name (see `serving`): its answers, state, error and end, or a file.

        Raises ConfigurationError.
        """
        table, place = table_of(answers, self._folder, **more)
        instrument = Instrument(table, place)
        add(self._stack, self._found, name, instrument)
        self._instruments[name] = instrument
        self._redirect()
        return instrument

    def unknown(self) -> list[str]:
        """A sentence about each instrument whose table lacks commands that came, and an `error` for them."""
        return [
            f"{name} was sent {', '.join(map(repr, one.unknown))}, which its table does not have, or whose "
            "value does not fit: add it, or give the table an error."
            for name, one in self._instruments.items()
            if one.unknown and one.table.error is None
        ]

    def __enter__(self) -> Self:
        self._redirect()
        return self

    def __exit__(self, *_: object) -> None:
        self._redirection.close()
        self._stack.close()

    def _redirect(self) -> None:
        self._redirection.close()
        found = self._found
        self._redirection.enter_context(redirected(found.serial, found.visa, found.hosts))
