"""What a file holds, before anybody says what it means: columns of numbers, brought onto one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import DataError
from ..views import About
from .start_times import Start


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


# Columns that a file gives clocks of their own, brought onto one.
#
# A channel of TDMS, NWB, UFF or XDF states its rate and the instant of its first sample, or that of each.
# Channels that began at different instants are cut to the time that all of them lasted; a difference that is
# no whole number of samples is interpolated by a cubic spline. What cannot be brought onto one clock is
# refused.

_SAME_RATE = 1e-6
_WHOLE = 0.01
"""Part of a sample by which starts may differ and be the same."""
_EVEN = 0.01
"""Largest deviation of an instant from an even grid, in samples."""


def together(path: Path, columns: Sequence[Column]) -> tuple[list[Column], list[str]]:
    """Columns without instants of their own and with one start, and sentences on what was done.

    Raises DataError for columns that do not belong together.
    """
    own = [one for one in columns if one.times is not None]
    first = own[0].times if own else None
    if first is not None and all(
        (one.times is None and len(one.values) == len(first))
        or (one.times is not None and np.array_equal(one.times, first))
        for one in columns
    ):
        since = next((one.since.later(float(first[0])) for one in columns if one.since is not None), None)
        time = Column("time", "", first - first[0], stamps=True, since=since)
        return [time, *(replace(one, times=None, start_s=None) for one in columns)], []
    return _aligned(path, [_even(path, one) for one in columns])


def _even(path: Path, column: Column) -> Column:
    """A column with rate and start in place of even instants. Raises DataError for uneven ones."""
    times = column.times
    if times is None or len(times) < 2:
        return replace(column, times=None)
    step = (times[-1] - times[0]) / (len(times) - 1)
    if not step > 0 or np.abs(times - times[0] - step * np.arange(len(times))).max() > _EVEN * step:
        raise DataError(
            f"{path} gives {column.name!r} uneven instants that other columns do not share: export those "
            "that belong together."
        )
    return replace(column, times=None, rate_hz=float(f"{1 / step:.9g}"), start_s=float(times[0]))


def _aligned(path: Path, columns: list[Column]) -> tuple[list[Column], list[str]]:
    starts = {one.start_s for one in columns if one.start_s is not None}
    rates = {one.rate_hz for one in columns}
    rate = next(iter(rates)) if rates else None
    if len(starts) < 2:
        return columns, []
    if (
        rate is None
        or any(one.start_s is None for one in columns)
        or np.ptp(np.array([*rates])) > _SAME_RATE * rate
    ):
        early, late = (_named(columns, pick(starts)) for pick in (min, max))
        raise DataError(
            f"{path} states that {early} begins {max(starts) - min(starts):.6g} s before {late}, and not "
            "rate and start of all columns: export those that belong together."
        )
    latest = max(starts)
    shifts = [(latest - float(one.start_s or 0.0)) * rate for one in columns]
    length = min(len(one.values) - int(np.ceil(s - _WHOLE)) for one, s in zip(columns, shifts, strict=True))
    if length < 3:
        raise DataError(
            f"{path}: {_named(columns, min(starts))} ends before {_named(columns, latest)} begins, "
            f"{latest - min(starts):.6g} s after it: export what was measured at the same time."
        )
    if max(shifts) < _WHOLE:
        return columns, []
    note = (
        f"{_named(columns, min(starts))} begins {latest - min(starts):.6g} s before "
        f"{_named(columns, latest)}: its first {max(shifts):.4g} samples were left out."
    )
    return [
        replace(one, values=_shifted(one.values, shift)[:length], start_s=latest)
        for one, shift in zip(columns, shifts, strict=True)
    ], [note]


def _shifted(values: FloatArray, shift: float) -> FloatArray:
    """Values from `shift` samples on."""
    whole = round(shift)
    if abs(shift - whole) < _WHOLE:
        return values[whole:]
    places = np.arange(int(np.ceil(shift)), len(values)) - np.ceil(shift) + shift
    finite = np.isfinite(values)
    if not finite.all():
        return np.where(
            finite[np.floor(places).astype(int)], np.interp(places, np.arange(len(values)), values), np.nan
        )
    return np.asarray(scipy.interpolate.CubicSpline(np.arange(len(values)), values)(places))


def _named(columns: Sequence[Column], start: float) -> str:
    return ", ".join(one.name or "a column" for one in columns if one.start_s == start)
