"""What is understood of a file: its signals, and what it does not say."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError
from ..columns import Start, Table
from .mapping import FileMapping, Role
from .timebase import Hole


@dataclass(frozen=True)
class Question:
    """Something that the file does not say."""

    key: Role | str
    """What is asked for: a role, "rate", or "unit ROLE", "flip ROLE", "rest ROLE", "where COLUMN"."""
    what: str
    """For a sentence: "the unit of force (column 1, F)"."""
    option: str
    """How it is told: "--unit force=N"."""


@dataclass(frozen=True, eq=False)
class Signal:
    """One column that means something."""

    role: Role
    number: int
    """Of the column, from 0."""
    heading: str
    why: str
    """By what right: "told", "by its unit", "by its heading"."""
    unit: str
    """Words on what one of the file's units is."""
    factor: float
    """SI units per unit of the file, with the sign."""
    values: FloatArray
    """(samples,) in SI on the even grid; empty while there is a question."""


@dataclass(frozen=True, eq=False)
class Understanding:
    """What was understood of a file, and what was not."""

    path: Path
    table: Table
    mapping: FileMapping
    """All that was told or taken, explicitly: with it, the next file needs no word."""
    signals: dict[str, Signal]
    rate_hz: float
    """NaN while it is not known."""
    questions: tuple[Question, ...]
    notes: tuple[str, ...]
    """Sentences with figures: rate, jitter, gaps, missing values, gravity."""
    holes: tuple[Hole, ...] = ()
    start: Start | None = None
    """What the file states of the instant of its first sample; None where it states nothing."""

    @property
    def sha256(self) -> str:
        """Of the file's bytes."""
        return hashlib.sha256(self.path.read_bytes()).hexdigest()

    @property
    def duration(self) -> float:
        """Seconds."""
        lengths = [len(s.values) for s in self.signals.values() if s.role != "time"]
        return max(lengths, default=0) / self.rate_hz

    def answered(self, question: Question, answer: str) -> FileMapping:
        """The mapping with the answer to a question. Raises ConfigurationError for one that is none."""
        what, _, role = question.key.partition(" ")
        told: dict[str, object]
        if what == "flip":
            told = {"flip": (role,)}
        elif what in ("unit", "rest"):
            told = {"units" if what == "unit" else "rest": {role: answer}}
        elif what == "rate":
            told = {"rate_hz": answer}
        elif what == "where":
            told = {"where": {role: answer}}
        else:
            told = {what: int(answer) if answer.isdecimal() else answer}
        return self.mapping.but(FileMapping.told(told, "the answer"))

    def require(self) -> None:
        """Raise ConfigurationError, one sentence, when a question is open."""
        if self.questions:
            what = _listed([q.what for q in self.questions], "nor")
            raise ConfigurationError(
                f"{self.path} does not say {what}: add, for example, "
                f"{_listed([q.option for q in self.questions], 'and')}."
            )


def _listed(parts: list[str], last: str) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"
