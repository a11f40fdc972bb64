"""Recovery: salvage the intact part of an interrupted, truncated or damaged recording into a new file."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ...base.checksum import opened, stated, unreadable
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.files import existing, os_error_text, stamp
from ...base.marks import is_marked, marked
from ...base.own_process import allow_memory, answer_of
from ...base.publishing import publish
from ...instruments import NewFile
from .file_format import Contents, Header, read_header
from .recording import Recording
from .rows import EVENT, Event, event_row, events_in, verdicts_in
from .salvage import intact_part, later_rows, read_blocks, reopened, write_finished
from .streams import files_in, reading_event


def recover(path: str | Path) -> Path:
    """Salvage the intact part of a recording into a new file `<name>.recovered.h5`; `path` is not touched.

    For a recording that was interrupted, truncated, damaged or changed. Blocks are kept up to the first one
    that does not match its checksum. The new file's last event states what was saved and what was lost.
    Raises ConfigurationError when there is nothing to recover or the new file exists, DataError when the
    file's metadata are damaged.
    """
    path = Path(path)
    if path.is_dir():
        raise DataError(f"{path} is a folder: name a recording in it.")
    destination = path.with_name(f"{path.stem}.recovered.h5")
    if destination.exists():
        raise ConfigurationError(existing(destination))
    if is_marked(path):
        raise ConfigurationError(f"{path} is being recorded now: wait until the session has ended.")
    try:
        header, contents, lost = _unfinished(path)
    except DataError:
        if not path.is_file():
            raise
        _recover_elsewhere(path, destination)
    else:
        _save(path, destination, header, contents, lost)
    return destination


def set_aside(path: Path) -> Path | None:
    """Rename an interrupted recording without a press, so that the same command can be given again.

    Returns its new path (`P01-latch.empty-1.h5`), or None for a recording that is complete, in
    progress, holds any press, or cannot be read; such a file is not changed.
    """
    try:
        recording = Recording.open(path)
        held = recording.complete or recording.in_progress or recording.verdicts
        if held or any(event.kind == "pressed" for event in recording.events):
            return None
    except DataError:
        return None
    number = 1
    try:
        with marked(path):
            while (aside := path.with_name(f"{path.stem}.empty-{number}{path.suffix}")).exists():
                number += 1
            publish(path, aside)
    except OSError as error:
        raise ConfigurationError(
            f"{path} holds no press, and cannot be renamed ({os_error_text(error)}): move it away yourself."
        ) from None
    return aside


def _unfinished(path: Path) -> tuple[Header, Contents, str]:
    """Read an undamaged file that was not finished. Raises DataError for a damaged one."""
    mark = stamp(path)
    with opened(path) as file:
        header, state = read_header(file, path)
        if state != "recording":
            raise ConfigurationError(f"{path} is complete: there is nothing to recover.")
        return header, read_blocks(file, header, partial(reopened, path, header, mark)), _lost(file)


def _lost(file: h5py.File) -> str:
    if later := later_rows(file):
        names = " and ".join(f"{number} {name}" for name, number in later.items())
        return f"{names} after damaged ones; only blocks before a damaged one are kept."
    return "samples after the last block are lost."


def _save(path: Path, destination: Path, header: Header, contents: Contents, lost: str) -> None:
    samples = contents.codes.shape[1]
    accepted = len({press.number for press in verdicts_in(contents.presses) if press.accepted})
    saved = f"Recovered {samples / header.rate_hz:.2f} s with {accepted} of {header.presses} presses accepted"
    streams = _streams_left(path, header)
    if gone := ", ".join(name for name, file in streams.items() if file is None):
        lost += f" No file is there of the stream {gone}."
    named = {file.file for file in files_in(events_in(contents.events))}
    left = [
        reading_event(samples, "streams", NewFile(name, file), path.parent)
        for name, file in streams.items()
        if file is not None and file.name not in named
    ]
    events = [*left, Event(samples, "recovered", f"{saved}; {lost}")]
    rows = np.frombuffer(b"".join(map(event_row, events)), dtype=EVENT)
    contents = replace(contents, events=np.concatenate([contents.events, rows]))
    write_finished(destination, header, contents, "recovered", in_place=False)


def recover_damaged(path: Path, destination: Path, allow: Callable[[int], object] = int) -> None:
    """Recover a file that does not match its checksum, within the calling process.

    The HDF5 library can crash, hang or exhaust memory on such a file, so `recover` calls this in a process
    of its own. Header, rows and blocks are compared with checksums of their own. `allow` is told the bytes
    of memory that its samples need. Raises as `recover`.
    """
    with _padded(path) as file:
        header, state = read_header(file, path)
        if state == "recording":
            contents, lost = read_blocks(file, header), _lost(file)
        else:
            needed = 6 * len(header.channels) * int(sum(map(int, file["blocks"]["count"])))
            allow(min(needed, _MEMORY) + _OF_BLOCK * len(file["blocks"]))
            contents = intact_part(file, header)
            lost = f"the rest of {file['codes'].shape[1] / header.rate_hz:.2f} s is damaged."
        if not len(contents.codes):
            raise DataError(f"{path} holds no intact block, so nothing can be recovered: copy it again.")
        _save(path, destination, header, contents, lost)


_LOST = "{} is damaged in its metadata, so nothing can be recovered: copy it again from its source."
_MEMORY, _OF_BLOCK = 1 << 28, 400
"""Bytes that the samples of a recovery take at most, and the row of each block."""
_PACE = 1 << 28
"""Bytes of a file for which a recovery has another minute."""
_MOST = 1000
"""Times that a truncated file may have been longer."""


def _recover_elsewhere(path: Path, destination: Path) -> None:
    """Run `recover_damaged` in a process of its own, with limited time and memory. Raises as `recover`."""
    damaged = DataError(_LOST.format(path))
    try:
        said = json.loads(answer_of(__name__, path, destination, pace=_PACE))
    except ValueError:
        raise damaged from None
    except OSError as error:
        raise DataError(
            f"{path} is damaged, and no process for its recovery can be started ({os_error_text(error)})."
        ) from None
    kinds = {kind.__name__: kind for kind in (ConfigurationError, DataError, InstrumentError)}
    if said["error"] in kinds:
        raise kinds[said["error"]](said["text"])
    if said["error"]:
        raise damaged


def _in_child() -> None:
    path, destination = map(Path, sys.argv[1:])
    error = text = ""
    allow_memory(0)
    try:
        recover_damaged(path, destination, allow_memory)
    except Exception as raised:
        error, text = type(raised).__name__, str(raised)
    sys.stdout.write(json.dumps({"error": error, "text": text}))


@contextmanager
def _padded(path: Path) -> Iterator[h5py.File]:
    """Open a damaged file; a truncated one reads as zeros beyond its end. Raises DataError."""
    length = path.stat().st_size
    with suppress(DataError):
        length = max(length, min(stated(path).count, _MOST * length))
    with (
        _Padded(path, length) as padded,
        unreadable(path, _LOST.format(path)),
        h5py.File(padded, "r", locking=False) as file,
    ):
        yield file


def _streams_left(path: Path, header: Header) -> dict[str, Path | None]:
    """By name, the file of each stream, whole up to the cut; None where none is there."""
    streams = json.loads(header.rig).get("streams") or {"inlets": ()}
    found: dict[str, Path | None] = {}
    for name in streams["inlets"]:
        written = re.compile(rf"{re.escape(path.stem)}-{re.escape(name)}(?:\.(\d+))?\.xdf")
        matches = filter(None, (written.fullmatch(one.name) for one in path.parent.iterdir()))
        # Those with a lower number are of sessions that ended before their first press.
        last = max(matches, key=lambda match: int(match[1] or 1), default=None)
        found[name] = path.parent / last[0] if last else None
    return found


class _Padded(io.RawIOBase):
    """A file padded with zeros to `length` bytes for reading."""

    def __init__(self, path: Path, length: int) -> None:
        self._file = path.open("rb")
        self._length = length
        self._at = 0

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._length}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        wanted = max(0, min(len(buffer), self._length - self._at))
        self._file.seek(self._at)
        found = self._file.read(wanted)
        buffer[:wanted] = found.ljust(wanted, b"\0")
        self._at += wanted
        return wanted

    def close(self) -> None:
        self._file.close()
        super().close()
