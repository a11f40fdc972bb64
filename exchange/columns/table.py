"""What a file holds, before anybody says what it means: columns of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ...instruments.arrays import FloatArray
from ..views import About


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
    times: FloatArray | None = None
    """(samples,) s: instants of the samples on that clock, of a column that the file gives its own."""
    doubt: str = ""
    """Why `unit` is "" although the file says something: both sides of a contradiction."""

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True, eq=False)
class Table:
    """The columns of a file."""

    path: Path
    kind: str
    """How it was read, for people: "semicolons between columns, decimal commas, 3 lines before the rows"."""
    columns: tuple[Column, ...]
    rate_hz: float | None = None
    """Samples per second, where the file states it for all columns."""
    rate_from: str = ""
    """Where the file states it."""
    about: About = field(default_factory=dict)
    """What a file of haploop's own says about itself."""
    notes: tuple[str, ...] = ()
    """Sentences on what was read in another way than one might expect."""

    @property
    def by_name(self) -> Mapping[str, int]:
        """Numbers of columns by name and by heading; a name that two columns have is not in it."""
        found: dict[str, int] = {}
        twice = set()
        for number, column in enumerate(self.columns):
            for name in {column.name, column.heading}:
                if name in found:
                    twice.add(name)
                found[name] = number
        return {name: number for name, number in found.items() if name and name not in twice}
