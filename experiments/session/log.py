"""The log of a session: one line an event, durable before the next thing happens.

How no line of it is lost unnoticed, see `base.line_files`. The event "complete" seals a log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...base.clock import Clock
from ...base.errors import DataError
from ...base.line_files import Line, LineFile, Mark, check_mark, read_lines, read_marks, write_marks


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
        self._file = LineFile(path, durable)
        self.events: list[Event] = list(events_of(path, self._file.lines))
        self._run = max((event.run for event in self.events), default=0) + 1
        if self.events:
            self.add("resumed")

    def add(self, kind: str, **values: Any) -> Event:
        """Write one event; when this returns, it is on the disk, if the log is durable.

        After an answer, the beginning and the end, the log's mark says how far it has come; without
        `durable`, after the beginning and the end.
        """
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        if kind in ("start", "complete"):
            values["sealed"] = kind == "complete"
        line = self._file.add(event=kind, time=now, at=round(self._clock.now(), 6), run=self._run, **values)
        self.events.append(_event(self._path, line))
        if kind in ("start", "complete") or (self._durable and kind == "answer"):
            try:
                self._mark()
            except DataError:
                self._file.close()  # who asked does not know that the event is in the log
                raise
        return self.events[-1]

    def close(self) -> None:
        """Mark how far the log has come, and close the file. May be called again."""
        self._file.close()
        if self._file.lines:
            self._mark()

    def _mark(self) -> None:
        folder, name = self._path.parent.parent, f"{self._path.parent.name}/{self._path.name}"
        marks, mark = read_marks(folder), Mark.of(self._file.lines)
        if marks.get(name) != mark:
            write_marks(folder, {**marks, name: mark})


def read_log(path: Path) -> tuple[Event, ...]:
    """Read a log. Raises DataError, with the line, when it is damaged, and when its end is missing.

    A last line that was cut off by an interruption is left out; so is one that is followed by an event that
    says so.
    """
    lines = read_lines(path)
    check_mark(path, lines)
    return events_of(path, lines)


def events_of(path: Path, lines: Sequence[Line]) -> tuple[Event, ...]:
    """The events in the lines of a log. Raises DataError for a line that is none."""
    return tuple(_event(path, line) for line in lines)


def _event(path: Path, line: Line) -> Event:
    entry = dict(line.values)
    number = entry.pop("number")
    entry.pop("previous")
    try:
        kind, time = str(entry.pop("event")), str(entry.pop("time"))
        at, run = float(entry.pop("at")), int(entry.pop("run"))
    except (LookupError, TypeError, ValueError, OverflowError):
        raise DataError(
            f"{path}, line {number} is no event of a session: restore the file from a copy."
        ) from None
    return Event(number, kind, time, at, run, entry)
