"""What is understood of a file, what a person says of it, and where its signals rest."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator

from ...base.arrays import FloatArray
from ...base.bounded import Strict
from ...base.errors import ConfigurationError
from ...base.files import new_file
from ...base.validation import parse_toml, read_text, validate
from ..columns import SI, Start, Table, zone_of
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


# What a person says of a lab's files: which column is what, in which unit. A small TOML file.

Role = Literal["time", "force", "acceleration", "displacement", "activation"]
ROLES: tuple[Role, ...] = ("time", "force", "acceleration", "displacement", "activation")
"""What a column can be; acceleration is the vertical one."""
MEASURED: tuple[Role, ...] = ("force", "acceleration", "displacement")
"""Roles with a unit."""
_TABLES = ("units", "rest", "where")
"""Entries with entries of their own."""
NONE = "none"
"""Told as a column: no column is that role."""
Place = Annotated[int, Field(ge=0, le=9999)] | Annotated[str, Field(min_length=1, max_length=200)] | None
_QUANTITIES = {role: SI[role] for role in ROLES if role in SI}


class FileMapping(Strict):
    """What is not told is taken from the file where it states it, and asked for where it does not."""

    time: Place = None
    """Column of the time: a heading, or a number from 0."""
    force: Place = None
    acceleration: Place = None
    displacement: Place = None
    activation: Place = None
    rate_hz: float | None = None
    """Samples per second; a column of time is then not looked at."""
    units: dict[str, str] = Field(default_factory=dict)
    """By role: a unit (mN), what one of the file's units is (40 N), or a sensitivity (100 mV/g)."""
    flip: tuple[Role, ...] = ()
    """Roles whose sign is changed: force and displacement rise when pressed, acceleration is positive up."""
    rest: dict[str, End] = Field(default_factory=dict)
    """By role: whether its start or its end shows it without a finger, where the two disagree."""
    where: dict[str, str] = Field(default_factory=dict)
    """Of a table of several measurements, by column: the value of the rows to take, or * for all."""
    skip_damaged: bool = False
    """Leave damaged rows of a text out, as gaps."""
    format: str | None = None
    """How the file is read; by default as its name ends."""
    zone: str | None = None
    """Time zone of dates that state none: an offset (+02:00) or a place (Europe/Berlin)."""
    decimal: Literal[",", "."] | None = None
    """Decimal sign of a text, where the file leaves a doubt."""
    make: Literal["recording", "press", "curve"] | None = None
    """A recording of all presses, or the representative press that one press is."""
    button: str | None = None
    participant: str | None = None
    names: str | None = None
    """Pattern of files' names without their ending, * for anything: "{participant}_{button}_*"."""

    @field_validator("units")
    @classmethod
    def _of_roles(cls, units: dict[str, str]) -> dict[str, str]:
        for role in units:
            if role not in (*_QUANTITIES, "response"):
                raise ValueError(f"{role!r} has no unit: use {', '.join(_QUANTITIES)}")
        return units

    @field_validator("zone")
    @classmethod
    def _that_is(cls, zone: str | None) -> str | None:
        if zone is not None and zone_of(zone) is None:
            raise ValueError(f"{zone!r} is no time zone: write +02:00, UTC or Europe/Berlin")
        return zone

    @field_validator("rest")
    @classmethod
    def _that_rest(cls, rest: dict[str, End]) -> dict[str, End]:
        for role in rest:
            if role not in ("force", "displacement"):
                raise ValueError(f"{role!r} has no rest: use force, displacement")
        return rest

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a mapping's file. Raises ConfigurationError."""
        path = Path(path)
        text = read_text(path, f"There is no mapping {path}: make one with --save-mapping.")
        return validate(cls, parse_toml(text, path), str(path))

    @classmethod
    def told(cls, said: dict[str, Any], source: str) -> Self:
        """A mapping of these values. Raises ConfigurationError that begins with `source`."""
        return validate(cls, said, source)

    def but(self, told: FileMapping) -> FileMapping:
        """The mapping, changed by what another one says."""
        said = told.model_dump(exclude_unset=True)
        tables = {name: {**getattr(self, name), **getattr(told, name)} for name in _TABLES}
        return self.model_copy(update={**said, **tables, "flip": tuple({*self.flip, *told.flip})})

    def save(self, path: str | Path) -> None:
        """Write a new file, without who pressed what: the next file may be another's.

        Raises ConfigurationError when it exists or cannot be written.
        """
        lines = ["# How haploop reads this lab's files: haploop import FILE --mapping THIS"]
        for key, value in self.model_dump(exclude={*_TABLES, "participant", "button"}).items():
            if value is not False and value not in (None, ()):
                lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
        for name in _TABLES:
            if table := getattr(self, name):
                said = (f"{json.dumps(key, ensure_ascii=False)} = {json.dumps(value, ensure_ascii=False)}"
                        for key, value in table.items())  # fmt: skip
                lines += ["", f"[{name}]", *said]
        with new_file(path) as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")


# Where a signal of force or travel rests: what it shows before the first press and after the last one.
#
# Model: a file begins or ends without a finger on the button. A median of the whole file is no rest: a button
# held for more than half of it would be called upside down. Where start and end disagree so far that the
# signal rises from one and falls from the other, only a person knows which of them is the rest.

End = Literal["start", "end"]
_SHARE, _FEWEST, _LONGEST = 0.02, 5, 0.1
"""Of a file, samples, and s: how much of its start and end is looked at."""
_NEAR = 0.1
"""Difference of start and end, over the signal's span, up to which they agree: creep, drift and noise."""
_FALLS = 2.0
"""A signal is upside down when it falls from its rest by more than this multiple of its rise."""


@dataclass(frozen=True)
class Rest:
    """The values (in the signal's unit) at both ends of a file, and how far the signal goes from them."""

    start: float
    end: float
    seconds: float
    """Length of either end that was looked at."""
    low: float
    high: float
    """The signal's smallest and largest value."""

    @property
    def agrees(self) -> bool:
        """True when start and end show the same rest."""
        return abs(self.end - self.start) <= _NEAR * (self.high - self.low)

    def at(self, told: End | None) -> float:
        """The value at rest: at the end that was told, else where both agree their mean, else the start."""
        if told == "end":
            return self.end
        return 0.5 * (self.start + self.end) if told is None and self.agrees else self.start

    def falls(self, told: End | None) -> bool | None:
        """Whether the signal falls from its rest when pressed; None where start and end disagree on it."""
        ends = [self.at(told)] if told or self.agrees else [self.start, self.end]
        found = {rest - self.low > _FALLS * (self.high - rest) for rest in ends}
        return found.pop() if len(found) == 1 else None

    def words(self, told: End | None, unit: str) -> str:
        """The rest, and where in the file it was taken from."""
        length = f"{1e3 * self.seconds:.3g} ms"
        if told is not None:
            return (
                f"{self.at(told):.3g} {unit}, in its {'last' if told == 'end' else 'first'} {length}, as told"
            )
        if self.agrees:
            return f"{self.at(None):.3g} {unit}, in its first and last {length}"
        return f"{self.start:.3g} {unit} in its first {length}, {self.end:.3g} in its last"


def rest_of(values: FloatArray, rate_hz: float) -> Rest:
    """The rest of (samples,), from both ends."""
    most = max(_FEWEST, round(_LONGEST * rate_hz))
    count = min(max(_FEWEST, round(_SHARE * len(values))), most, len(values))
    return Rest(
        float(np.median(values[:count])), float(np.median(values[-count:])), count / rate_hz,
        float(values.min()), float(values.max()))  # fmt: skip
