"""The file of a tape: gzip of JSON lines, each with the hash of all lines so far, the last one `end`."""

from __future__ import annotations

import gzip
import hashlib
import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

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
    rest, total = bytearray(), 0
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
                    rest += part
                    if b"\n" in part:
                        *lines, last = bytes(rest).split(b"\n")
                        yield from lines
                        rest = bytearray(last)
                    if len(rest) > _LONGEST:
                        raise DataError(f"The tape {path} was changed: a line has no end.")
                if unpacking.eof and (unpacking.unused_data or file.read(1)):
                    raise DataError(f"The tape {path} was changed: something follows its end.")
    except zlib.error as error:
        raise DataError(f"The tape {path} was changed ({error}): have it sent again.") from None
    except OSError as error:
        raise ConfigurationError(
            f"The tape {path} cannot be read: {(error.strerror or '').lower()}."
        ) from None
