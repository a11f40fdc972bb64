"""Where the answers of an experiment lie, and the log of a session: one durable line an event.

`DATA/P01/session-1.jsonl` is the log of P01's first session. Everything that P01 answered lies in that
folder. `DATA/marks.json` knows how far each log had come, so that none loses its end or vanishes unnoticed.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from ...acquisition import file_name
from ...base.clock import Clock
from ...base.errors import ConfigurationError, DataError
from ...base.files import os_error_text
from ...base.line_files import Line, LineFile, Mark, check_mark, read_lines, read_marks, write_marks
from ...base.marks import InUse
from ...instruments.safety import hold
from ..protocol import Answer, Assignment, Course, Experiment, Step, group_of_slot, load_experiment, valid

# The log of a session: one line an event, durable before the next thing happens.
#
# How no line of it is lost unnoticed, see `base.line_files`. The event "complete" seals a log.


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


_WITHDRAWALS = "withdrawals.jsonl"
_ANOTHER_DAY = timedelta(hours=12)
"""Time since a session from which the next one may be another day's."""


@dataclass(frozen=True)
class StoredSession:
    """One session, as its log tells it."""

    path: Path
    assignment: Assignment
    events: tuple[Event, ...]
    answers: tuple[tuple[Step, Answer, Event], ...]
    """Each answered step, with the answer and its event, in order."""
    due: Step | None
    """Step that is due; None when every step is answered."""

    @property
    def simulated(self) -> bool:
        """True when a simulated participant answered."""
        return bool(self.events[0].values["simulated"])

    @property
    def complete(self) -> bool:
        """True when every step is answered and the log is sealed: nothing of it is missing."""
        return self.due is None and self.events[-1].values.get("sealed") is True


@dataclass(frozen=True)
class Withdrawal:
    """What a withdrawal has deleted."""

    participant: str
    files: tuple[str, ...]
    time: str


class Store:
    """Answers to an experiment in a folder."""

    def __init__(self, experiment: Experiment, folder: str | Path) -> None:
        self.experiment = experiment
        self.folder = Path(folder)

    def participants(self) -> tuple[str, ...]:
        """Pseudonyms with a session that was begun, sorted; also of one whose log has vanished since.

        Raises DataError when a withdrawal was not finished.
        """
        if not self.folder.is_dir():
            return ()
        withdrawn = self._withdrawn()
        for path in self.folder.iterdir():
            if path.name.casefold() in withdrawn and path.is_dir():
                raise DataError(
                    f"{path.name} has withdrawn, and not everything was deleted: withdraw {path.name} again."
                )
        here = {path.name for path in self.folder.iterdir() if (path / "session-1.jsonl").is_file()}
        return tuple(sorted(here | {who for who in self._marked() if who.casefold() not in withdrawn}))

    def path_of(self, participant: str, session: int) -> Path:
        """Path of a session's log."""
        return self.folder / participant / f"session-{session}.jsonl"

    def heads(self) -> dict[str, Mapping[str, Any]]:
        """The values of the first event of each participant: assignment, and whether one is simulated."""
        found = {}
        for who in self.participants():
            path = self.path_of(who, 1)
            lines = read_lines(path, only_first=True) if path.is_file() else ()
            if not lines:
                check_mark(path, lines)
            for event in events_of(path, lines):
                found[who] = _head(path, event)
        return found

    def session(self, participant: str, session: int) -> StoredSession | None:
        """A session that was begun, or None.

        Raises DataError: damaged, missing or cut short since it was written, or of another experiment.
        """
        path = self.path_of(participant, session)
        if not path.is_file():
            check_mark(path, ())
            return None
        events = read_log(path)
        if not events:
            return None  # killed before the first event was whole
        answered = any(event.kind == "answer" for event in events)
        if answered and f"{participant}/{path.name}" not in read_marks(self.folder):
            self.participants()  # says so when a withdrawal was not finished
            raise DataError(f"{self.folder / 'marks.json'} does not know {path}: restore it from a copy.")
        return self._replayed(path, participant, session, events)

    def sessions(self) -> tuple[StoredSession, ...]:
        """All sessions that were begun, by participant and number. Raises DataError."""
        numbers = range(1, self.experiment.file.sessions + 1)
        found = (self.session(who, number) for who in self.participants() for number in numbers)
        return tuple(one for one in found if one)

    def unfinished(self) -> tuple[StoredSession, ...]:
        """Sessions that were begun and not completed. Raises DataError."""
        return tuple(one for one in self.sessions() if not one.complete)

    def next_session(self, participant: str) -> int | None:
        """Number of the participant's first session that is not complete; None when all are."""
        for number in range(1, self.experiment.file.sessions + 1):
            found = self.session(participant, number)
            if found is None or not found.complete:
                return number
        return None

    def soon_after(self, participant: str, session: int) -> float | None:
        """Hours since the session before this one ended, where that is less than half a day.

        None otherwise, for the first session, and for one that has begun.
        """
        before = self.session(participant, session - 1) if session > 1 else None
        if before is None or self.session(participant, session) is not None:
            return None
        since = datetime.now(UTC) - datetime.fromisoformat(before.events[-1].time)
        return since.total_seconds() / 3600 if since < _ANOTHER_DAY else None

    def assign(self, participant: str, session: int) -> Assignment:
        """Assignment of a participant; a new one gets the first free place in the design.

        Raises ConfigurationError: no valid pseudonym, one that differs from another by case only, or one that
        has withdrawn.
        """
        file_name(participant, "x")  # refuses what is no pseudonym
        slots = {who: int(head["slot"]) for who, head in self.heads().items()}
        for who in self.participants():
            if who != participant and who.casefold() == participant.casefold():
                raise ConfigurationError(
                    f"{participant} and {who} differ only in upper and lower case: use {who}."
                )
        if participant.casefold() in self._withdrawn():
            raise ConfigurationError(
                f"{participant} has withdrawn: use a pseudonym that was not used before."
            )
        slot = slots.get(participant, next(n for n in range(len(slots) + 1) if n not in slots.values()))
        return Assignment(participant, slot, group_of_slot(self.experiment.file, slot), session)

    @contextmanager
    def hold(self, what: str) -> Iterator[None]:
        """Lock the folder against other programs; `what` is named to them. Raises ConfigurationError."""
        with ExitStack() as stack:
            try:
                stack.enter_context(hold({f"experiment {os.path.normcase(self.folder.resolve())}"}, what))
            except InUse as error:  # no instrument has failed: another operator is at work
                raise ConfigurationError(str(error)) from None
            yield

    def withdraw(self, participant: str) -> Withdrawal:
        """Delete everything in the participant's folder and its marks, and note that it was done.

        Names of files are noted, and nothing of what they held. Exported tables, recordings and backups
        elsewhere are not touched. Raises DataError: nobody of that name, or a file that cannot be deleted.
        """
        folder = self.folder / participant
        with self.hold(f"The experiment {self.experiment.file.name!r}"):
            if not re.fullmatch(r"[A-Za-z0-9]+", participant) or not self._is_here(participant):
                known = ", ".join(self.participants()) or "nobody"
                raise DataError(f"There is nothing of {participant} in {self.folder}, only of {known}.")
            files = tuple(
                path.relative_to(self.folder).as_posix()
                for path in sorted(folder.rglob("*"))
                if path.is_file()
            )
            now = datetime.now(UTC).isoformat(timespec="seconds")
            # Before anything is deleted: if this stops halfway, the note tells that a withdrawal was begun.
            marks = self._marks_of_others(participant)
            try:
                with closing(LineFile(self.folder / _WITHDRAWALS)) as notes:
                    notes.add(participant=participant, time=now, files=files)
                    write_marks(self.folder, {**marks, _WITHDRAWALS: Mark.of(notes.lines)})
            except DataError as error:
                raise DataError(f"{error} Nothing is deleted without it.") from None
            try:
                if folder.is_dir():
                    shutil.rmtree(folder)
            except OSError as error:
                raise DataError(
                    f"{error.filename or folder} cannot be deleted ({os_error_text(error)}): close what uses "
                    f"it, and withdraw {participant} again."
                ) from None
        return Withdrawal(participant, files, now)

    def withdrawals(self) -> tuple[Withdrawal, ...]:
        """Withdrawals so far. A note that was cut off is left out: nothing had been deleted yet.

        Raises DataError for notes that cannot be read or are damaged.
        """
        path = self.folder / _WITHDRAWALS
        lines = read_lines(path) if path.exists() else ()
        check_mark(path, lines)
        notes = [line.values for line in lines]
        try:
            said = [(note["participant"], tuple(note["files"]), note["time"]) for note in notes]
        except (LookupError, TypeError):
            raise DataError(f"{path} has a line that is no withdrawal: restore it from a copy.") from None
        return tuple(Withdrawal(*one) for one in said)

    def _marked(self) -> set[str]:
        """Those of whom there is a mark."""
        return {name.partition("/")[0] for name in read_marks(self.folder) if "/" in name}

    def _marks_of_others(self, participant: str) -> dict[str, Mark]:
        marks = read_marks(self.folder)
        return {name: mark for name, mark in marks.items() if name.partition("/")[0] != participant}

    def _is_here(self, participant: str) -> bool:
        """Whether there is anything of a participant, if only a mark."""
        folder = self.folder / participant
        if os.path.lexists(folder):
            return folder.is_dir() and not folder.is_symlink()
        return participant in self._marked()

    def _withdrawn(self) -> set[str]:
        """Those who have withdrawn, without regard to case."""
        return {one.participant.casefold() for one in self.withdrawals()}

    def _replayed(
        self, path: Path, participant: str, session: int, events: tuple[Event, ...]
    ) -> StoredSession:
        head = _head(path, events[0])
        if head.get("experiment") != self.experiment.content_hash:
            raise DataError(
                f"{path} was begun with another version of {self.experiment.path}: restore that version, "
                "or use another folder for the changed experiment."
            )
        if (head.get("participant"), head.get("session")) != (participant, session):
            raise DataError(f"{path} is a session of {head.get('participant')}: put it back into its folder.")
        if head["slot"] < 0 or head["group"] != group_of_slot(self.experiment.file, head["slot"]):
            raise DataError(f"{path} is of a group that is not in the design: restore the file from a copy.")
        assignment = Assignment(participant, head["slot"], head["group"], session)
        answers: list[tuple[Step, Answer, Event]] = []
        course = Course(self.experiment.file, assignment)
        due = course.due(())
        for event in events:
            if event.kind != "answer":
                continue
            said = event.values
            if due is None or (said.get("block"), said.get("trial")) != (due.block, due.number):
                raise DataError(f"{path}: the answer in line {event.number} is to no step that was due.")
            answers.append((due, valid(due, said.get("answer")), event))
            due = course.due([one[:2] for one in answers])
        return StoredSession(path, assignment, events, tuple(answers), due)


def _head(path: Path, event: Event) -> Mapping[str, Any]:
    """The values of a session's first event. Raises DataError for another event."""
    kinds = {"slot": int, "group": str, "simulated": bool}
    if event.kind == "start" and all(type(event.values.get(key)) is kind for key, kind in kinds.items()):
        return event.values
    raise DataError(f"{path} does not begin as a session does: restore the file from a copy.")


def due_sessions(folder: Path) -> tuple[str, ...]:
    """Return who began a session of an experiment and did not complete it; "" where nobody has answered.

    Raises ConfigurationError and DataError for an experiment, or answers, that cannot be read.
    """
    store = Store(load_experiment(folder), folder / "answers")
    return tuple(one.assignment.participant for one in store.unfinished()) if store.participants() else ("",)
