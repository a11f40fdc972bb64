"""The file of a tape: gzip of JSON lines, each with the hash of all so far; arguments and answers as JSON."""

from __future__ import annotations

import base64
import binascii
import gzip
import hashlib
import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ...base.errors import ConfigurationError, DataError

KIND, VERSION = "haploop tape", 1
_HEX = 16
"""Digits of the running hash in each line."""
_LONGEST = 1 << 28
"""Longest line (bytes): half an hour of one channel at 5 kS/s in one call has a fifth of it."""
_CHUNK, _STEP = 1 << 16, 1 << 20
_LEAST, _RATIO = 1 << 26, 30
"""Bytes that any tape may unpack to, and more for each byte of the file: of noise gzip leaves a third."""


class TapeWriter:
    """Writes lines; each is in the file once `flush` has returned. Raises OSError."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb")
        self._packed = gzip.GzipFile(fileobj=self._file, mode="wb", filename="", mtime=0)
        self._hash = hashlib.sha256()

    def write(self, said: Mapping[str, Any]) -> None:
        """Append a line."""
        body = json.dumps(said, separators=(",", ":"), ensure_ascii=True)[:-1]
        self._hash.update(body.encode())
        self._packed.write(f'{body},"hash":"{self._hash.hexdigest()[:_HEX]}"}}\n'.encode())

    def flush(self) -> None:
        """Hand everything to the system: a program that is killed now loses nothing."""
        self._packed.flush(zlib.Z_SYNC_FLUSH)
        self._file.flush()

    def close(self) -> None:
        """End the file."""
        try:
            self._packed.close()
        finally:
            self._file.close()


@dataclass(frozen=True)
class TapeLines:
    """What a tape holds, without its first and last line."""

    head: Mapping[str, Any]
    lines: tuple[Mapping[str, Any], ...]
    whole: bool
    """False when the last line is missing: the program was killed, or the file was cut off."""

    @classmethod
    def of(cls, path: Path) -> Self:
        """Read and verify a tape; see `read_tape`."""
        return cls(*read_tape(path))


def read_tape(path: Path) -> tuple[Mapping[str, Any], tuple[Mapping[str, Any], ...], bool]:
    """First line of a tape, the lines between, and whether the last one is there.

    Raises ConfigurationError for a file that is missing or no tape, DataError for one that was changed.
    """
    running = hashlib.sha256()
    said: list[Mapping[str, Any]] = []
    ended = False
    for number, line in enumerate(_unpacked(path), 1):
        body, mark, stated = line.rpartition(b',"hash":"')
        running.update(body)
        if ended or not mark or stated != f'{running.hexdigest()[:_HEX]}"}}'.encode():
            if number == 1:
                raise ConfigurationError(f"{path} is no tape: name a file that --tape has written.")
            raise DataError(f"The tape {path} was changed: its line {number} does not match its hash.")
        try:
            entry = json.loads(body + b"}")
        except (ValueError, RecursionError):
            raise DataError(f"The tape {path} was changed: its line {number} is no JSON.") from None
        ended = isinstance(entry, dict) and entry.get("is") == "end"
        said.append(entry)
    head = said[0] if said else {}
    if head.get("format") != KIND or head.get("version") != VERSION:
        raise ConfigurationError(
            f"{path} is no tape of version {VERSION}: name a file that --tape of this haploop has written."
        )
    if ended and said[-1].get("lines") != len(said) - 1:
        raise DataError(f"The tape {path} was changed: it has {len(said) - 1} lines before its last one.")
    return head, tuple(said[1 : -1 if ended else None]), ended


def _unpacked(path: Path) -> Iterator[bytes]:
    """Whole lines of a file; what is cut off at its end is left out."""
    unpacking = zlib.decompressobj(wbits=31)
    # Pieces of a line: bytes that grow are copied, and leave a hole each time in the heap of a large process.
    rest: list[bytes] = []
    total = 0
    try:
        most = _LEAST + _RATIO * path.stat().st_size
        with path.open("rb") as file:
            while packed := file.read(_CHUNK):
                while packed:
                    part = unpacking.decompress(packed, _STEP)
                    packed, total = unpacking.unconsumed_tail, total + len(part)
                    if total > most:
                        raise DataError(
                            f"The tape {path} unpacks to more than {most >> 20} MB, which no session does: "
                            "have it sent again."
                        )
                    *lines, last = part.split(b"\n")
                    if lines:
                        yield b"".join([*rest, lines[0]])
                        yield from lines[1:]
                        rest = []
                    rest.append(last)
                    if sum(map(len, rest)) > _LONGEST:
                        raise DataError(f"The tape {path} was changed: a line has no end.")
                if unpacking.eof and (unpacking.unused_data or file.read(1)):
                    raise DataError(f"The tape {path} was changed: something follows its end.")
    except zlib.error as error:
        raise DataError(f"The tape {path} was changed ({error}): have it sent again.") from None
    except OSError as error:
        raise ConfigurationError(
            f"The tape {path} cannot be read: {(error.strerror or '').lower()}."
        ) from None


# Arguments and answers as JSON: numbers, text, bytes, arrays, and handles of objects that have no text.


@dataclass(frozen=True)
class Handle:
    """Stands for an object that a device's library gave: a task, a capture."""

    number: int


class Handles:
    """Numbers objects in the order in which they are first seen; keeps them, so that no number is reused."""

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {}
        self._kept: list[object] = []

    def number(self, thing: object) -> int:
        """Number of an object, or of what it stands for."""
        if isinstance(thing, Handle):
            return thing.number
        if id(thing) not in self._numbers:
            self._numbers[id(thing)] = len(self._kept)
            self._kept.append(thing)
        return self._numbers[id(thing)]


def as_json(value: Any, handles: Handles, hidden: Mapping[str, str]) -> Any:
    """A value as JSON; texts in `hidden` are replaced."""
    if isinstance(value, Enum | np.generic):
        value = value.value if isinstance(value, Enum) else value.item()
    if isinstance(value, str):
        for text, instead in hidden.items():
            value = value.replace(text, instead)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list):
        return [as_json(part, handles, hidden) for part in value]
    return _told(value, handles, hidden)


def _told(value: Any, handles: Handles, hidden: Mapping[str, str]) -> dict[str, Any]:
    told: dict[str, Any]
    match value:
        case bytes() | bytearray():
            told = {"b": as_json(bytes(value).decode("latin-1"), handles, hidden)}
        case np.ndarray():
            told = {"a": [value.dtype.str, list(value.shape), text_of(value)]}
        case tuple():
            told = {"t": [as_json(part, handles, hidden) for part in value]}
        case dict():
            told = {"d": {str(key): as_json(part, handles, hidden) for key, part in value.items()}}
        case _ if is_dataclass(value) and not isinstance(value, type | Handle):
            told = {"d": {type(value).__name__: as_json(asdict(value), handles, hidden)}}
        case _:
            told = {"o": handles.number(value)}
    return told


def from_json(told: Any) -> Any:
    """The value of what `as_json` gave; a `Handle` for an object. Raises ValueError for anything else."""
    if isinstance(told, list):
        return [from_json(part) for part in told]
    if not isinstance(told, dict):
        return told
    value: Any
    match told:
        case {"b": str(text)}:
            value = text.encode("latin-1")
        case {"a": [str(kind), list(shape), str(text)]}:
            value = array_of(kind, shape, text)
        case {"t": list(parts)}:
            value = tuple(from_json(part) for part in parts)
        case {"d": dict(parts)}:
            value = {key: from_json(part) for key, part in parts.items()}
        case {"o": int(number)}:
            value = Handle(number)
        case _:
            raise ValueError(f"no value is told by {str(told)[:60]}")
    return value


def text_of(array: NDArray[Any]) -> str:
    """An array's bytes as text, sorted by their place in a value: like bytes beside each other pack well."""
    whole = np.ascontiguousarray(array)
    sorted_bytes = whole.view(np.uint8).reshape(-1, whole.itemsize).T if whole.size else whole
    return base64.b64encode(sorted_bytes.tobytes()).decode("ascii")


def array_of(kind: str, shape: list[Any], text: str) -> NDArray[Any]:
    """The array of what `text_of` gave. Raises ValueError for another text."""
    dtype = np.dtype(kind)
    if dtype.hasobject:
        raise ValueError("an array holds no objects")
    try:
        packed = np.frombuffer(base64.b64decode(text, validate=True), np.uint8)
        whole = packed.reshape(dtype.itemsize, -1).T.copy() if packed.size else packed
        return whole.reshape(-1).view(dtype).reshape([int(length) for length in shape])
    except (binascii.Error, TypeError, OverflowError) as error:
        raise ValueError(f"no array is told by its text ({error})") from None
