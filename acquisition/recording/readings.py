"""Numbers and files recorded along, stored as events of a recording.

An event's text has a limited length and is part of the recording's hash. The event of a file states its
name and SHA-256, so that a later replacement of the file is detected.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ...base.errors import DataError
from ...base.files import beside
from ...instruments import NewFile, Reading
from .rows import EVENT, Event

_LONGEST = EVENT["text"].itemsize


class AlongReading(NamedTuple):
    """A number read from an instrument while recording."""

    sample: int
    """Number of samples recorded at the time of the request."""
    instrument: str
    """Its role in the rig file."""
    name: str
    value: float
    unit: str


class AlongFile(NamedTuple):
    """A file that an instrument wrote beside the recording."""

    sample: int
    """Number of samples recorded at the time of the request."""
    instrument: str
    """Its role in the rig file."""
    name: str
    file: str
    """The file's name, in the recording's folder."""
    sha256: str


def reading_event(sample: int, instrument: str, read: Reading | NewFile, folder: Path) -> Event:
    """Make an event from an instrument's reading or file; a file is read once, for its hash.

    `folder` is the recording's. Raises DataError for content that an event cannot hold, OSError for a
    file that cannot be read.
    """
    if not (read.name + getattr(read, "unit", "")).isprintable():
        raise DataError(f"The name or unit of {read.name[:20]!r} has characters that cannot be printed.")
    about: dict[str, object] = {"instrument": instrument, "name": read.name}
    if isinstance(read, NewFile):
        kind = "file"
        if read.path.absolute().parent != folder.absolute():
            raise DataError(f"The file {read.path} must be in the recording's folder, {folder}.")
        with read.path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        about |= {"file": read.path.name, "sha256": sha256}
    else:
        kind = "reading"
        value = float(read.value)
        if not math.isfinite(value):
            raise DataError(f"The {read.name} was {value}, which is no reading.")
        about |= {"value": value, "unit": read.unit}
    text = json.dumps(about, ensure_ascii=False)
    if len(text.encode()) > _LONGEST:
        raise DataError(
            f"The names of {read.name[:20]!r} are too long for an event, which has {_LONGEST} bytes for them."
        )
    return Event(sample, kind, text)


def readings_in(events: Sequence[Event]) -> tuple[AlongReading, ...]:
    """Decode the readings among events."""
    found = [(e.sample, json.loads(e.text)) for e in events if e.kind == "reading"]
    return tuple(AlongReading(s, a["instrument"], a["name"], a["value"], a["unit"]) for s, a in found)


def files_in(events: Sequence[Event]) -> tuple[AlongFile, ...]:
    """Decode the files among events."""
    found = [(e.sample, json.loads(e.text)) for e in events if e.kind == "file"]
    return tuple(AlongFile(s, a["instrument"], a["name"], a["file"], a["sha256"]) for s, a in found)


def file_problems(events: Sequence[Event], folder: Path) -> tuple[str, ...]:
    """Check the files recorded along; return one sentence for each problem."""
    problems = []
    for written in files_in(events):
        try:
            path = beside(folder, written.file, "The recording", DataError)
        except DataError as error:
            problems.append(str(error))
            continue
        try:
            with path.open("rb") as file:
                found = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            problems.append(f"{path}, which was recorded along, cannot be read ({error.strerror or error}).")
            continue
        if found != written.sha256:
            problems.append(f"{path} was changed after it was recorded: its SHA-256 does not match.")
    return tuple(problems)
