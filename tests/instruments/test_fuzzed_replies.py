"""Whatever an instrument answers, its driver ends with a value that the answer says, or one sentence.

Replies are mutated from good ones and made of noise, and go through each driver's own path from bytes
to values; what carries the bytes is in memory. What a reply may say is written down a second time
here, apart from the codecs: what does not look so must not come out as data.
"""

from __future__ import annotations

import io
import json
import math
import random
import re
import socket
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

import pytest

from haploop.base.clock import VirtualClock
from haploop.base.errors import HaploopError, InstrumentError
from haploop.instruments.generator.role import error_of, number_of, switch_of, words_of
from haploop.instruments.relay.board import ChannelState
from haploop.instruments.relay.serial_relay import SerialRelay
from haploop.instruments.relay.serial_relay import _Board as SerialBoard
from haploop.instruments.relay.yocto import _Board as YoctoBoard
from haploop.instruments.relay.yocto import _Hub
from haploop.instruments.transport.text_line import Port, TextLine
from haploop.instruments.vibrometer.ofv5000 import duration_of, frequency_of, level_of, scale_of

NUMBER = r"(\d+(\.\d*)?|\.\d+)"
POWER = r"([eE][+-]?\d{1,2})?"
VELOCITY = r"\s*[uµm]?m\s*/\s*s\s*/\s*V"
FREQUENCY = rf"{NUMBER}{POWER}\s*[kM]?Hz|\d{{4,}}(\.\d*)?|{NUMBER}[eE]\+?\d{{1,2}}|not available"
SEED = 20
ODD = (
    b"nan", b"inf", b"-1", b"0", b"1e400", b"9" * 400, b"1_000", b"0x10", b"True", b"null", b"\x00", b"\xff",
    b"\r", b"\n", b",", b'"', b"{", b"\xd9\xa3", b"9.91E+37", b"9.9E+37", b"-9.9E+37", b" ", b"__import__",
)  # fmt: skip


def replies(good: tuple[bytes, ...], seed: int) -> Iterator[bytes]:
    """Without end: good replies with bytes changed, cut, doubled, swapped or put in, and noise."""
    r = random.Random(seed)
    while True:
        reply = bytearray(r.choice(good))
        for _ in range(r.randint(0, 3)):
            at = r.randint(0, len(reply))
            match r.randint(0, 6):
                case 0 if reply:
                    reply[at % len(reply)] ^= 1 << r.randint(0, 7)
                case 1:
                    del reply[at : at + r.randint(1, 6)]
                case 2:
                    reply[at:at] = reply[at : at + r.randint(1, 20)]
                case 3:
                    reply[at:at] = r.choice(ODD)
                case 4:
                    reply[at:at] = r.randbytes(r.randint(1, 8))
                case 5:
                    reply = bytearray(r.choice(good))[:at] + reply[at:]
                case _:
                    reply[at : at + 3] = r.choice(ODD)
        yield bytes(reply if r.random() < 0.95 else r.randbytes(r.randint(0, 60)))


class Said(Port):
    """A port on which one reply has come, and whose deadline passes when that has been read."""

    def __init__(self, reply: bytes, clock: VirtualClock) -> None:
        self._left = io.BytesIO(reply)
        self._clock = clock

    def send(self, data: bytes) -> None:
        pass

    def receive(self, wait: float) -> bytes:
        byte = self._left.read(1)
        if not byte:
            self._clock.sleep(wait)
        return byte

    def close(self) -> None:
        pass


class Immediate(TextLine):
    """A line whose time is virtual."""

    def __init__(self, reply: bytes) -> None:
        clock = VirtualClock()
        super().__init__("The instrument", lambda: Said(reply, clock), "its 'port'", 1.0)
        self._clock = clock


def outcome(reply: bytes, parse: Callable[[str], Any]) -> tuple[str, Any] | None:
    """The text that arrived and what it was taken for; None when it was refused."""
    line = Immediate(reply)
    try:
        text = line.receive("a question")
    except InstrumentError as error:
        assert "\n" not in str(error)
        return None
    try:
        return text, parse(text)
    except ValueError:
        return None


OFV = (
    (scale_of, rf"{NUMBER}{POWER}{VELOCITY}", (b"5mm/s/V\n", b"100 um/s/V\n", b"1m/s/V\n"), 1e-12, 1e3),
    (duration_of, rf"{NUMBER}{POWER}\s*([nuµm]?s)?", (b"12.3 us\n", b"1.1ms\n", b"7\n"), 0.0, 10.0),
    (frequency_of, FREQUENCY, (b"20 kHz\n", b"Not Available\n"), 1, 1e9),
    (level_of, r"\d{1,3}", (b"512\n", b"0\n", b"37\n"), 0.0, 1.0),
)  # fmt: skip


@pytest.mark.parametrize(("parse", "form", "good", "low", "high"), OFV)
def test_a_vibrometers_reply(parse, form, good, low, high, full):
    taken = 0
    for reply in islice(replies(good, SEED), 100_000 if full else 4000):
        found = outcome(reply, parse)
        if found is None:
            continue
        text, value = found
        assert re.fullmatch(form, text, re.IGNORECASE | re.ASCII), (text, value)
        assert value is None or low <= value <= high, (text, value)
        taken += 1
    assert taken > 100, "whole replies among them are taken"


def test_a_generators_numbers(full):
    good = (b"+1.000000000000000E+00\n", b"1.600000\n", b"625\n", b"+9.900000000000000E+37\n", b"INFINITY\n")
    for reply in islice(replies(good, SEED), 100_000 if full else 6000):
        found = outcome(reply, number_of)
        if found is None:
            continue
        text, value = found
        if re.fullmatch(r"INF(INITY|INITE)?", text, re.IGNORECASE):
            assert value == math.inf
            continue
        number = r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?"
        assert re.fullmatch(number, text, re.IGNORECASE | re.ASCII), (text, value)
        assert not math.isnan(value)
        assert value == float(text) or (value == math.inf and float(text) > 9e37)


def test_a_generators_other_words(full):
    errors = b'-113,"Undefined header"\n', b'+0,"No error"\n'
    good = (b"1\n", b"OFF\n", *errors, b"Rigol,DG1062Z,DG1,03.01.12\n")
    for reply in islice(replies(good, SEED), 100_000 if full else 6000):
        if found := outcome(reply, switch_of):
            assert found[0].upper() in ("0", "1", "ON", "OFF")
        if found := outcome(reply, error_of):
            assert re.match(r"[+-]?\d+\s*,", found[0], re.ASCII)
            assert found[1][0] == int(found[0].split(",")[0])
        if found := outcome(reply, words_of):
            assert found[0].count(",") == 3


class Wire:
    """What pyserial would be, with a whole conversation said before it begins."""

    def __init__(self, said: list[bytes]) -> None:
        self._said = iter(said)

    def open(self) -> None:
        pass

    def reset_input_buffer(self) -> None:
        pass

    def write(self, data: bytes) -> None:
        pass

    def read_until(self, expected: bytes, size: int) -> bytes:
        reply = next(self._said, b"")[:size]
        end = reply.find(expected)
        return reply if end < 0 else reply[: end + 1]

    def close(self) -> None:
        pass


def test_a_relay_boards_reply(monkeypatch, full):
    """Whether a channel is closed is believed of the board's own words only."""
    said: list[bytes] = []
    monkeypatch.setattr("serial.serial_for_url", lambda *_, **__: Wire(said))
    settings = SerialRelay.Settings.model_validate({"patches": {"A": 3}, "rating": 48, "port": "COM5"})
    good = (b"relay read 3\n\ron\n\r>", b"relay read 3\n\roff\n\r>")
    for reply in islice(replies(good, SEED), 100_000 if full else 4000):
        said[:] = [b"\n\r>", b"ver\n\r00000008\n\r>", reply]
        board = SerialBoard(settings)
        try:
            states = board.states()
        except HaploopError as error:
            assert "\n" not in str(error)
            continue
        word = re.fullmatch(rb"[\r\n]*relay read 3[\r\n]+(on|off)[\r\n]+>.*", reply, re.DOTALL)
        assert word, reply
        assert states == {3: ChannelState(closed=word[1] == b"on")}


class Link:
    """What a socket to a hub would be, once the hub has said all and closed."""

    def __init__(self, reply: bytes) -> None:
        self._left = io.BytesIO(reply)

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def sendall(self, data: bytes) -> None:
        pass

    def settimeout(self, wait: float) -> None:
        pass

    def recv_into(self, buffer: Any) -> int:
        return self._left.readinto(buffer)


def test_a_hubs_reply(monkeypatch, full):
    """Each channel that comes out stands so in an answer that is whole JSON under a status of success."""
    relay = {"state": 1, "pulseTimer": 1500, "maxTimeOnStateB": 120000}
    module = {"serialNumber": "MXCOUPL1-1", "productName": "Yocto-MaxiCoupler-V2"}
    tree = {"module": module, "relay1": relay, "relay2": relay | {"state": 0, "pulseTimer": 0}}
    body = json.dumps(tree).encode()
    head = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n" % len(body)
    chunked = (
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n%x\r\n" % len(body) + body + b"\r\n0\r\n\r\n"
    )
    good = (head + body, b"HTTP/1.0 200 OK\r\n\r\n" + body, chunked, b"HTTP/1.1 404 Not Found\r\n\r\n")
    reply = b""
    monkeypatch.setattr(socket, "create_connection", lambda *_: Link(reply))
    board = YoctoBoard.__new__(YoctoBoard)
    board.identity, board._root = "The box", "/bySerial/MXCOUPL1-1"
    board._hub = _Hub("http://127.0.0.1:4444", 1.0)
    taken = 0
    for reply in islice(replies(good, SEED), 100_000 if full else 4000):
        try:
            states = board.states()
        except HaploopError as error:
            assert "\n" not in str(error)
            continue
        # 100 may come before the answer; what counts is that no failure's body is believed.
        status = re.match(r"HTTP/1\.\S*\s+(\S+)", reply.decode("latin-1"))
        assert status is not None and int(status[1]) in (100, 200), reply
        for channel, state in states.items():
            assert b"relay%d" % channel in reply or b"\\u" in reply
            assert state.remaining == math.inf or 0 < state.remaining < (1 << 32) / 1000
        taken += 1
    assert taken > 100
