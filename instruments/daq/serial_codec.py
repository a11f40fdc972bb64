r"""Settings and frames of a board that streams samples: bytes in, samples out.

No I/O; the twin writes with the same values.

A text board sends one line a sample: `12345,678\n`. A binary one sends a fixed structure after bytes that
mark its beginning (sync), and may end it with a checksum of all bytes between. A decoder finds its place by
itself: what comes before the first whole frame belongs to none. After that every byte belongs to a frame, and
what cannot be read is a damaged frame, which is reported and takes its place among the samples: it is never
left out.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ...base.bounded import Baud, Finite, NotNegative, Positive, Strict
from ..config import RigFile, lacks

Frame = tuple[float, ...] | None
"""Values of the columns of one frame; None for a damaged one."""
_LONGEST_LINE = 4096
"""Bytes without a line's end after which they are given up."""
_CHECKSUMS = {"none": 0, "sum8": 1, "xor8": 1, "crc16": 2}


class Framing(Strict):
    """How a board writes its samples: either `separator` or `struct`."""

    separator: str | None = None
    """Of text: what stands between two columns, such as `,`; a space stands for any number of blanks."""
    columns: Annotated[int, Field(strict=True, ge=1, le=64)] | None = None
    """Of text: numbers in a line. Lines that begin with # are no samples."""
    decimals: Annotated[int, Field(strict=True, ge=0, le=9)] | None = None
    """Of text: digits behind the decimal point, which the twin prints."""
    struct: str | None = None
    """Of binary frames: the columns as Python's struct module writes them, such as `<Hhh`."""
    sync: str = ""
    """Of binary frames: the bytes that begin each one, in hexadecimal, such as `AA55`."""
    checksum: Literal["none", "sum8", "xor8", "crc16"] = "none"
    """Of binary frames: over the structure's bytes, at the end. crc16 is Modbus's, low byte first."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.separator is None) == (self.struct is None):
            raise ValueError(
                "write either separator and columns, for lines of text, or struct and sync, for binary frames"
            )
        if self.separator is not None:
            if self.columns is None:
                raise ValueError("separator needs columns: how many numbers stand in a line")
            if self.sync or self.checksum != "none":
                raise ValueError("sync and checksum are of binary frames: take them out, or write struct")
            if len(self.separator) != 1:
                raise ValueError("separator must be one character, such as ',' or ' '")
            return self
        if self.decimals is not None:
            raise ValueError("decimals are of lines of text: take them out, or write separator and columns")
        try:
            width = len(struct.unpack(self.struct or "", bytes(struct.calcsize(self.struct or ""))))
        except struct.error as error:
            raise ValueError(f"struct {self.struct!r} is none of Python's struct module ({error})") from None
        if (self.struct or "")[:1] not in "<>!=" or not width or set(self.struct or "") & set("spcxPnN?"):
            raise ValueError(
                f"struct {self.struct!r} must begin with < or > and have numbers only, such as '<Hhh'"
            )
        if self.columns is not None and self.columns != width:
            raise ValueError(f"struct {self.struct!r} has {width} columns: leave columns out")
        try:
            marks = bytes.fromhex(self.sync)
        except ValueError:
            raise ValueError(f"sync {self.sync!r} must be bytes in hexadecimal, such as 'AA55'") from None
        if not marks:
            raise ValueError("binary frames need sync: the bytes that begin each one, such as 'AA55'")
        return self

    @property
    def width(self) -> int:
        """Number of columns."""
        if self.struct is None:
            return int(self.columns or 0)
        return len(struct.unpack(self.struct, bytes(struct.calcsize(self.struct))))

    def encode(self, values: Sequence[float]) -> bytes:
        """Return the frame of these values, as the board would write it."""
        if self.struct is None:
            return (str(self.separator).join(f"{value:.10g}" for value in values) + "\n").encode()
        codes = [
            round(v) if code not in "efd" else v for v, code in zip(values, _codes(self.struct), strict=True)
        ]
        body = struct.pack(self.struct, *codes)
        return bytes.fromhex(self.sync) + body + _checksum(self.checksum, body)

    def whole(self, column: int) -> bool:
        """True when a column can carry whole numbers only."""
        return self.struct is not None and _codes(self.struct)[column] not in "efd"

    def limits(self, column: int) -> tuple[float, float]:
        """Smallest and largest value that a column can carry."""
        if self.struct is None or (code := _codes(self.struct)[column]) in "efd":
            return -math.inf, math.inf
        bits = 8 * struct.calcsize(f"<{code}")
        return (0.0, 2.0**bits - 1) if code.isupper() else (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1)


def _codes(structure: str) -> str:
    """One code for each column: `<2hI` has `hhI`."""
    codes, count = "", ""
    for letter in structure[1:]:
        if letter.isdigit():
            count += letter
        elif letter.strip():
            codes, count = codes + letter * int(count or 1), ""
    return codes


def _checksum(kind: str, body: bytes) -> bytes:
    match kind:
        case "sum8":
            return bytes([sum(body) & 0xFF])
        case "xor8":
            value = 0
            for byte in body:
                value ^= byte
            return bytes([value])
        case "crc16":
            return _crc16(body).to_bytes(2, "little")
    return b""


def _crc16(body: bytes) -> int:
    """Modbus's: polynomial 0xA001, reflected, from 0xFFFF."""
    value = 0xFFFF
    for byte in body:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0xA001 if value & 1 else 0)
    return value


class Decoder:
    """Takes bytes as they come, and returns the frames that have become whole."""

    def __init__(self, framing: Framing) -> None:
        self._framing = framing
        self._pending = bytearray()
        self._placed = False
        """True once a whole frame was seen, from which on each byte belongs to one."""
        self._astray = 0
        """Bytes since the last whole frame."""

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes, and return the frames that they complete."""
        self._pending += data
        return self._lines() if self._framing.struct is None else self._structures()

    def _lines(self) -> list[Frame]:
        *lines, rest = self._pending.split(b"\n")
        self._pending = rest
        frames: list[Frame] = []
        for line in lines:
            text = line.strip()
            if not text or text.startswith(b"#"):
                self._placed = self._placed or bool(text)
                continue
            frame = self._numbers(bytes(text))
            # The first line may have lost its beginning, and be read as another number.
            if self._placed:
                frames.append(frame)
            self._placed = True
        if len(self._pending) > _LONGEST_LINE:
            self._pending.clear()
            frames.append(None)
        return frames

    def _numbers(self, text: bytes) -> Frame:
        separator = str(self._framing.separator)
        try:
            parts = text.decode("ascii").split(None if separator == " " else separator)
            values = tuple(float(part) for part in parts)
        except ValueError:
            return None
        whole = len(values) == self._framing.columns and bool(np.isfinite(values).all())
        return values if whole else None

    def _structures(self) -> list[Frame]:
        framing, pending = self._framing, self._pending
        sync, body = bytes.fromhex(framing.sync), struct.calcsize(framing.struct or "")
        size = len(sync) + body + _CHECKSUMS[framing.checksum]
        frames: list[Frame] = []
        while len(pending) >= size + (0 if self._placed else len(sync)):
            frame = self._structure(pending, sync, body, size)
            if frame is not None and (self._placed or pending[size:].startswith(sync)):
                self._placed = True
                frames.append(frame)
                del pending[:size]
                self._astray = 0
                continue
            # One damaged frame for as many bytes as a frame has; before the first whole one there is none.
            if self._placed and self._astray % size == 0:
                frames.append(None)
            self._astray += 1
            del pending[:1]
        return frames

    def _structure(self, pending: bytearray, sync: bytes, body: int, size: int) -> Frame:
        if not pending.startswith(sync):
            return None
        content = bytes(pending[len(sync) : len(sync) + body])
        if _checksum(self._framing.checksum, content) != bytes(pending[len(sync) + body : size]):
            return None
        values = tuple(float(value) for value in struct.unpack(self._framing.struct or "", content))
        return values if bool(np.isfinite(values).all()) else None


_COUNTS = 100.0
"""Whole numbers in a range from which a line of text has whole numbers."""


class Column(Strict):
    """A channel: a column of the board's frames."""

    column: Annotated[int, Field(strict=True, ge=1, le=64)]
    """Its number in the frame, from 1."""
    scale: Finite = 1.0
    """Volts for each unit that the board sends: an HX711 with 5 V and gain 128 has 20 mV / 2^23."""
    offset: Finite = 0.0
    """Volts at 0."""
    range: Positive
    """Full scale (+- V)."""

    @model_validator(mode="after")
    def _scaled(self) -> Self:
        if self.scale == 0:
            raise ValueError("a scale of 0 would lose what is measured: give volts for each unit")
        return self


class SharedEdge(Strict):
    """A signal that is wired to the DAQ and to the board: the button's contact, or a line that the board
    pulls.
    """

    channel: str
    """Channel of the DAQ."""
    threshold: Finite = 2.5
    """Its level (V)."""
    column: Annotated[int, Field(strict=True, ge=1, le=64)]
    """Column of the board's frames, from 1."""
    level: Finite = 0.5
    """Level in that column, as the board sends it."""


class SerialSettings(Strict):
    """The `[daq]` or `[adc]` table of a rig file."""

    port: str
    baud: Baud = 115_200
    rate_hz: Positive
    """Frames per second; recorded along, the nominal rate is enough."""
    frame: Framing
    channels: Annotated[dict[str, Column], Field(min_length=1)]
    counter: Annotated[int, Field(strict=True, ge=1, le=64)] | None = None
    """Column that counts frames, if there is one: then every lost one is known."""
    counter_modulo: Annotated[int, Field(strict=True, ge=2, le=1 << 32)] = 65_536
    """What the counter begins anew at."""
    start: str = ""
    """Text to send for the board to begin, such as `s\\n`."""
    latency: NotNegative = 0.005
    """Shortest time from a sample to its arrival (s; estimate: half a period of the board's filter and a
    transfer). An edge measures it."""
    latency_error: NotNegative = 0.01
    """How far off that may be (s; estimate: a USB adapter waits up to 16 ms)."""
    bridge: NotNegative = 0.05
    """Longest time of lost frames that is bridged when recorded along (s)."""
    edge: SharedEdge | None = None

    def digit(self, channel: Column) -> float:
        """What the last digit of a channel's column counts, in the board's units.

        1 for whole numbers: integers of a structure, and lines of text unless `frame.decimals` says more or
        the range has less than a hundred of them, as that of a board that prints volts.
        """
        if self.frame.whole(channel.column - 1):
            return 1.0
        if self.frame.decimals is not None:
            return float(10.0**-self.frame.decimals)
        steps = 2 * channel.range / abs(channel.scale)
        if steps >= _COUNTS and self.frame.struct is None:
            return 1.0
        return float(10.0 ** np.floor(np.log10(steps) - 5))

    @model_validator(mode="after")
    def _columns(self) -> Self:
        width = self.frame.width
        named = {f"channels.{name}": channel.column for name, channel in self.channels.items()}
        named |= {"counter": self.counter} if self.counter else {}
        named |= {"edge": self.edge.column} if self.edge else {}
        for name, column in named.items():
            if column > width:
                raise ValueError(f"{name} is column {column}, and a frame has {width}: correct one of them")
        taken: dict[int, str] = {}
        for name, channel in self.channels.items():
            first = taken.setdefault(channel.column, name)
            if first != name:
                raise ValueError(f"column {channel.column} has two names, {first!r} and {name!r}: keep one")
        if self.counter in taken:
            raise ValueError(f"column {self.counter} is the counter and {taken[self.counter]!r}: keep one")
        bits = 10 * self.rate_hz * len(self.frame.encode([0.0] * width))
        if self.frame.struct is not None and bits > self.baud:
            raise ValueError(
                f"{self.rate_hz:g} frames a second are {bits:g} baud, and baud is {self.baud}: raise "
                "baud, there and on the board"
            )
        return self

    def contradictions(self, file: RigFile) -> Iterator[tuple[str, str]]:
        """See `haploop.instruments.config.contradictions`."""
        if file.adc is None or file.adc.settings.get("port") != self.port:
            if file.rate_hz != self.rate_hz:
                clause = (
                    f"the only DAQ sends {self.rate_hz:g} frames a second, and recordings have rate_hz = "
                    f"{file.rate_hz:g}: write rate_hz = {self.rate_hz:g} at the top"
                )
                yield "rate_hz", clause
            return
        known = file.daq.settings.get("channels")
        for name in self.channels:
            if isinstance(known, Mapping) and name in known:
                yield "channels", f"{name!r} is also a channel of [daq]: give one of them another name"
        if self.edge is not None and lacks(file, "channels", self.edge.channel):
            clause = f"{self.edge.channel!r} is no channel of [daq]: name one of {', '.join(known or ())}"
            yield "edge", clause
