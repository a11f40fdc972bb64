"""The log of a session: one line of JSON an event, durable before the next thing happens.

Each line has a number and a hash, so that a line that is missing, repeated or changed is noticed. A line that
was cut off when the program was killed is kept as it is, and the next one says so.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...acquisition.json_files import read_lines, unended
from ...instruments import ConfigurationError, DataError
from ...instruments.clock import Clock
from ...instruments.files import os_error_text, sync_folder
from ...instruments.json_text import as_line

__all__ = ["Event", "EventLog", "read_log"]


@dataclass(frozen=True)
class Event:
    """One line of a log."""

    number: int
    kind: str
    time: str
    """UTC, ISO 8601."""
    at: float
    """s on the clock of the program that wrote it: for differences within one run."""
    run: int
    """Number of the program's run in this session, from 1; `at` of another run has another origin."""
    values: Mapping[str, Any]


class EventLog:
    """Appends events to a log. Raises DataError when the disk fails, and for a log that is damaged."""

    def __init__(self, path: Path, clock: Clock, durable: bool = True) -> None:
        """Without `durable`, the operating system chooses when to write: for simulated participants."""
        self._path, self._clock, self._durable = path, clock, durable
        open_end = cut_off = False
        self.events: list[Event] = []
        if path.exists():
            self.events = list(read_log(path))
            open_end, cut_off = unended(path)
        self._run = max((event.run for event in self.events), default=0) + 1
        try:
            path.parent.parent.mkdir(parents=True, exist_ok=True)
            # Answers of people are their keeper's, as recordings are.
            path.parent.mkdir(mode=0o700, exist_ok=True)
            # Without a buffer, which would be written once more on closing a full disk.
            self._file = open(path, "ab", buffering=0, opener=private)  # noqa: SIM115  closed by close()
            if not self.events:
                self._file.truncate(0)  # a first line that was cut off holds no answer
            elif open_end:
                self._write(b"\n")
            sync_folder(path.parent)
        except OSError as error:
            raise ConfigurationError(f"{path} cannot be written: {os_error_text(error)}.") from None
        if self.events:
            self.add("resumed", cut_off=cut_off)

    def add(self, kind: str, **values: Any) -> Event:
        """Write one event; when this returns, it is on the disk, if the log is durable."""
        number = self.events[-1].number + 1 if self.events else 1
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        event = Event(number, kind, now, round(self._clock.now(), 6), self._run, values)
        try:
            self._write(_line(event))
            if self._durable:
                os.fsync(self._file.fileno())
        except (OSError, ValueError) as error:
            text = os_error_text(error) if isinstance(error, OSError) else str(error)
            raise DataError(f"{self._path} cannot be written: {text}.") from None
        self.events.append(event)
        return event

    def _write(self, line: bytes) -> None:
        while line:
            line = line[self._file.write(line) :]

    def close(self) -> None:
        """Close the file. May be called again."""
        self._file.close()


def read_log(path: Path, only_first: bool = False) -> tuple[Event, ...]:
    """Read a log, or its first event. Raises DataError, with the line, when it is damaged.

    A last line that was cut off by an interruption is left out; so is one that is followed by an event that
    says so.
    """
    return tuple(_event(path, entry) for entry in read_lines(path, only_first))


def private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _line(event: Event) -> bytes:
    said = {"number": event.number, "event": event.kind, "time": event.time, "at": event.at, "run": event.run}
    return as_line({**said, **event.values}).encode()


def _event(path: Path, entry: dict[str, Any]) -> Event:
    number = entry.pop("number")
    try:
        kind, time = str(entry.pop("event")), str(entry.pop("time"))
        at, run = float(entry.pop("at")), int(entry.pop("run"))
    except (LookupError, TypeError, ValueError, OverflowError):
        raise DataError(
            f"{path}, line {number} is no event of a session: restore the file from a copy."
        ) from None
    return Event(number, kind, time, at, run, entry)
