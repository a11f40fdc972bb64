"""What a file holds, before anybody says what it means: columns of numbers, and what it states of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ...base.arrays import FloatArray
from ..views import About
from .started import Start


@dataclass(frozen=True)
class Stated:
    """A rate that a file states, in samples per second, and its words."""

    hz: float | None
    """None where it does not say in which unit, or where it contradicts itself."""
    words: str
    number: float = 0.0
    """Of a rate without `hz`, the number that stands there: a rate, or a step."""

    @classmethod
    def step(cls, seconds: float, words: str) -> Stated:
        """A rate that is stated as the time between two samples."""
        return cls(float(f"{1 / seconds:.9g}"), words)


@dataclass(frozen=True, eq=False)
class Column:
    """One column: (samples,), NaN where a value is missing."""

    name: str
    """As in the file; "" for a column without a heading."""
    unit: str
    """As in the file; "" where it states none."""
    values: FloatArray
    rate_hz: float | None = None
    """Samples per second, where the file states it for this column."""
    stamps: bool = False
    """True for dates and times, which `values` counts in s from the first."""
    start_s: float | None = None
    """Instant of the first sample (s), on a clock that all columns of the file share; None where unstated."""
    since: Start | None = None
    """Instant of that clock's zero, and of the zero of `values` in a column of times; None where unstated."""
    times: FloatArray | None = None
    """(samples,) s: instants of the samples on that clock, of a column that the file gives its own."""
    doubt: str = ""
    """Why the file contradicts itself about the unit, with both sides: the unit is then asked for."""
    quantity: str = ""
    """What the format itself says is measured, where it has a place for it: "force", "acceleration", ..."""
    also: tuple[str, ...] = ()
    """Other names by which the file calls it: the channel beneath a label."""

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit and self.unit != self.name else self.name

    def called(self, number: int) -> str:
        """The heading, with the column's number in place of a name that it has not."""
        unit = f" [{self.unit}]" if self.unit else ""
        return self.heading if self.name else f"column {number}{unit}"


@dataclass(frozen=True, eq=False)
class Labels:
    """A column of text: one text a row, "" where there is none."""

    name: str
    texts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Table:
    """The columns of a file."""

    path: Path
    kind: str
    """How it was read, for people: "semicolons between columns, decimal commas, 3 lines before the rows"."""
    columns: tuple[Column, ...]
    rates: tuple[Stated, ...] = ()
    """Rates that the file states for all columns; all of them, also those that differ."""
    about: About = field(default_factory=dict)
    """What a file of haploop's own says about itself."""
    notes: tuple[str, ...] = ()
    """Sentences on what was read in another way than one might expect."""
    labels: tuple[Labels, ...] = ()
    """Columns of text, which say what rows belong to."""
    damaged: tuple[int, ...] = ()
    """Numbers of rows that were left out as damaged: NaN in all columns."""
    starts: tuple[tuple[int, Start], ...] = ()
    """What the file states of its start, and of the start of each segment, by the row that it is of."""

    @property
    def by_name(self) -> Mapping[str, int]:
        """Numbers of columns by name, heading and other names; a name that two columns have is not in it."""
        found: dict[str, int] = {}
        twice = set()
        for number, column in enumerate(self.columns):
            for name in {column.name, column.heading, *column.also}:
                if name in found:
                    twice.add(name)
                found[name] = number
        return {name: number for name, number in found.items() if name and name not in twice}
