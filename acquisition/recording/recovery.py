"""Recovery: salvage the intact part of an interrupted, truncated or damaged recording into a new file."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from haploop.acquisition.recording.file_format import (
    EVENT,
    Codes,
    Contents,
    Event,
    Header,
    event_row,
    read_header,
    verdicts_in,
)
from haploop.acquisition.recording.recording import Recording
from haploop.acquisition.recording.salvage import (
    CHUNK,
    cut_short,
    ending_at,
    later_blocks,
    opened,
    read_blocks,
    read_contents,
    write_finished,
)
from haploop.instruments import ConfigurationError, DataError
from haploop.instruments.files import existing, os_error_text, publish
from haploop.instruments.safety import is_marked, marked

__all__ = ["recover", "set_aside"]


def recover(path: str | Path) -> Path:
    """Salvage the intact part of a recording into a new file `<name>.recovered.h5`; `path` is not touched.

    For a recording that was interrupted, truncated, or damaged in its samples. Samples are kept up to the
    first missing one. The new file's last event states what was saved and what was lost. Raises
    ConfigurationError when there is nothing to recover or the new file exists, DataError when the file's
    metadata are damaged, or the file was changed after it was finished.
    """
    path = Path(path)
    destination = path.with_name(f"{path.stem}.recovered.h5")
    if destination.exists():
        raise ConfigurationError(existing(destination))
    if is_marked(path):
        raise ConfigurationError(f"{path} is being recorded now: wait until the session has ended.")
    header, contents, lost = _whole(path) or _part(path)
    samples = contents.codes.shape[1]
    accepted = len({press.number for press in verdicts_in(contents.presses) if press.accepted})
    saved = f"Recovered {samples / header.rate_hz:.2f} s with {accepted} of {header.presses} presses accepted"
    event = np.frombuffer(event_row(Event(samples, "recovered", f"{saved}; {lost}")), dtype=EVENT)
    contents = replace(contents, events=np.concatenate([contents.events, event]))
    write_finished(destination, header, contents, "recovered", in_place=False)
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


def _whole(path: Path) -> tuple[Header, Contents, str] | None:
    """Read the contents of an interrupted file; None when the file is damaged."""
    try:
        with opened(path) as file:
            header, state = read_header(file, path)
            later = later_blocks(file["blocks"]) if state == "recording" else 0
        contents = read_contents(path)
    except DataError:
        return None
    if state == "recording":
        lost = "samples after the last block are lost."
        if later:
            lost = f"{later} blocks after a damaged block were left out."
        return header, contents, lost
    if contents.stored_hash != contents.hash(header):
        raise DataError(
            f"{path} was changed after it was finished, and its original content cannot be restored: "
            "use an unchanged copy."
        )
    raise ConfigurationError(f"{path} is complete: there is nothing to recover.")


def _part(path: Path) -> tuple[Header, Contents, str]:
    """Read the contents of a damaged file up to its first missing sample. Raises DataError."""
    with opened_beyond(path) as file:
        header, state = read_header(file, path)
        if state == "recording":
            contents = read_blocks(file, header)
            return header, contents, "samples after the last intact block are lost."
        stored = file["codes"]
        codes = _readable(stored)
        rows = [file[name][:] for name in ("blocks", "events", "presses")]
        recorded = stored.shape[1] / header.rate_hz
        lost = f"the rest of {recorded:.2f} s is damaged, and the saved part has no content hash to check."
        return header, ending_at(Contents(codes, *rows), codes.shape[1]), lost


def _readable(stored: h5py.Dataset) -> Codes:
    """Read the samples before the first missing or damaged chunk."""
    parts: list[Codes] = []
    with suppress(OSError, RuntimeError, ValueError):
        for start in range(0, stored.shape[1], CHUNK):
            parts.append(stored[:, start : start + CHUNK])
    return np.concatenate([np.zeros((stored.shape[0], 0), np.int16), *parts], axis=1)


@contextmanager
def opened_beyond(path: Path) -> Iterator[h5py.File]:
    """Open a file like `opened`; a truncated file reads as zeros beyond its end."""
    try:
        with h5py.File(path, "r"):
            pass
        length = 0
    except OSError as error:
        length = cut_short(str(error), path.stat().st_size if path.is_file() else 0)
    if not length:
        with opened(path) as file:
            yield file
        return
    with _Padded(path, length) as padded:
        try:
            with h5py.File(padded, "r") as file:
                yield file
        except (OSError, KeyError, ValueError, RuntimeError, UnicodeDecodeError):
            raise DataError(
                f"{path} is truncated within its metadata, so nothing can be recovered: "
                "copy it again from its source."
            ) from None


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
