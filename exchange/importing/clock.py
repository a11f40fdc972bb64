"""One time base of all that a file states of time: stamps, their unit, rates, and the first sample's instant.

Stamps are believed before rates, and a rate that contradicts them, or another rate, is asked about. A unit
that no heading states follows from a stated rate, where one unit brings both together; otherwise it is asked.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError
from ..columns import (
    LABVIEW_EPOCH,
    Column,
    Start,
    Stated,
    Table,
    instant,
    per_unit,
    since_epoch,
    unit_of,
    zone_of,
)
from .timebase import TimeBase, time_base
from .understood import FileMapping, Question

_AGREE = 0.01
"""Largest relative difference of two rates that are the same."""
EPOCH_NAME = re.compile(r"unix|epoch|posix|labview", re.I)
"""Headings of seconds since a date."""
_DATES = (1e8, 6e9)
"""s since 1970 or 1904 of any recording."""


def time_of(table: Table, candidates: Sequence[int], told: FileMapping) -> tuple[int, str] | Question | None:
    """Of columns that may be the time, the one; where they differ, a question.

    Columns that tell the same are one; those that state a unit come before those that do not.
    """
    known = {n: unit for n in candidates if (unit := _stated_unit(table.columns[n])) is not None}
    if len(candidates) < 2:
        return (candidates[0], "") if candidates else None
    if known:
        seconds = {n: factor * table.columns[n].values for n, (factor, _) in known.items()}
        finest = max(seconds, key=lambda n: len(np.unique(seconds[n])))
        if all(_same(seconds[finest], one) for one in seconds.values()):
            return finest, "; others tell the same"
    names = ", ".join(table.columns[n].heading or str(n) for n in candidates)
    return Question("time", f"which of {names} is the time, for they differ", "--time COLUMN")


def _same(one: FloatArray, other: FloatArray) -> bool:
    """True for stamps that differ by a constant, as far as their digits go."""
    apart = one - other
    apart = apart[np.isfinite(apart)]
    steps = [np.abs(np.diff(v[np.isfinite(v)])) for v in (one, other)]
    fine = max(float(np.min(s[s > 0], initial=np.inf)) for s in steps)
    return len(apart) > 0 and bool(np.abs(apart - apart[0]).max() <= fine)


def _stated_unit(column: Column) -> tuple[float, str] | None:
    """Seconds per unit of a column of stamps, and its words, where it states them."""
    if column.stamps:
        return 1.0, "s"
    if column.doubt:
        return None
    if (unit := unit_of(column.unit, "time")) is not None:
        return unit.factor, column.unit
    some = column.values[np.isfinite(column.values)]
    if not column.unit and EPOCH_NAME.search(column.name) and len(some) and _DATES[0] < some[0] < _DATES[1]:
        return 1.0, "s"
    return None


def unit_of_time(
    table: Table, number: int, rates: Sequence[Stated], told: FileMapping
) -> tuple[float, str] | Question:
    """Seconds per unit of the column of time, and the words; a question where nothing states them."""
    column = table.columns[number]
    if column.stamps:
        return 1.0, "s"
    if (said := told.units.get("time")) is not None:
        return per_unit("time", "time", said, column.unit)
    if (stated := _stated_unit(column)) is not None:
        return stated
    step = float(np.nanmedian(np.diff(column.values))) if len(column.values) > 2 else 0.0
    known = {rate.hz for rate in rates if rate.hz is not None}
    if len(known) == 1 and len(rates) == 1 and step > 0 and not column.doubt and not column.unit:
        (hz,) = known
        for name, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
            if hz is not None and abs(step * factor * hz - 1) < _AGREE:
                return factor, name
    name = column.called(number)
    rises = f"{name} rises by {step:.3g} a sample" if step > 0 else ""
    why = "; ".join(filter(None, (column.doubt, rises))) or name
    option = "--unit time=mm:ss or --unit time=hh:mm" if "hh:mm" in column.doubt else "--unit time=ms"
    return Question("unit time", f"the unit of its time ({why})", option)


def base_of(
    table: Table, number: int | None, unit: tuple[float, str] | None, taken: Sequence[int], told: FileMapping
) -> TimeBase | Question:
    """The time base of the columns `taken`, with the column of time `number`; or what must be asked.

    Raises DataError for stamps from which no rate follows.
    """
    if told.rate_hz is not None:
        return TimeBase(told.rate_hz, (f"{told.rate_hz:g} samples/s, as told",))
    rates = rates_of(table, taken)
    if number is not None and unit is not None:
        values = np.delete(table.columns[number].values, table.damaged)
        one = next((rate.hz for rate in rates if rate.hz is not None), None)
        base = time_base(table.path, values, unit[0], one)
        for rate in rates:
            if rate.hz is not None and abs(base.rate_hz / rate.hz - 1) > _AGREE:
                return Question(
                    "rate", f"which is right, its stamps of {base.rate_hz:g} samples/s or {rate.hz:g} "
                    f"({rate.words})", "--rate HZ")  # fmt: skip
        return base
    known = [rate for rate in rates if rate.hz is not None]
    if len(known) == len(rates) > 0 and _one(known):
        hz = known[0].hz
        assert hz is not None
        return TimeBase(hz, (f"{hz:g} samples/s, as the file says ({known[0].words})",))
    if rates:
        said = " and ".join(dict.fromkeys(rate.words for rate in rates))
        why = f"several rates: {said}" if len(rates) > 1 else f"{said}, without a clear unit"
        return Question("rate", f"its sample rate (it states {why})", "--rate HZ")
    return Question("rate", "its sample rate, or which column is the time", "--rate HZ or --time COLUMN")


def _one(rates: Sequence[Stated]) -> bool:
    hz = [rate.hz for rate in rates if rate.hz is not None]
    return max(hz) / min(hz) - 1 < 1e-4


def rates_of(table: Table, taken: Sequence[int]) -> list[Stated]:
    """What a file states of the rate of these columns, or of any where it states none of these."""
    stating = [n for n, column in enumerate(table.columns) if column.rate_hz is not None]
    places = [n for n in stating if n in taken] or stating
    own = {column.rate_hz: column for column in (table.columns[n] for n in places)}
    known = {rate.hz for rate in table.rates}
    return [
        *table.rates,
        *(Stated(hz, f"{hz:g} samples/s of {c.name}") for hz, c in own.items() if hz not in known),
    ]


# The instant of the first sample that is imported, of all that a file states of its start.
#
# A column of dates comes before a header, which may name the hour at which a file was made; the clock of a
# format's channels comes before it too. Without a stated time zone the clock time is kept as it stands there.

_SET = 1973
"""Year before which a clock was never set: 1970, 1904."""
_DAY = 86_400.0
_STEPS = 2.0
"""Samples at which a time begins at zero: some programs count from 0, others from 1."""


def began(
    table: Table, time: tuple[int, float] | None, taken: Sequence[int], told: FileMapping
) -> Start | None:
    """What the file states of its first sample; None where it states nothing.

    `time` is the column of time with its unit in s. Raises ConfigurationError for a clock time that the told
    time zone has twice or never.
    """
    dated = [(n, 1.0) for n, column in enumerate(table.columns) if column.stamps and column.since is not None]
    time = dated[0] if time is None and len(dated) == 1 else time
    found = _of_time(table, *time) if time is not None else None
    for column in (table.columns[number] for number in taken):
        if found is None and column.since is not None and not column.stamps:
            found = _after(column.since, column.start_s or 0.0)
    if found is None:
        found = next((start for row, start in table.starts if row == 0), None)
        if found is not None and not found.exact and time is not None and _is_apart(found, table, *time):
            found = Start(found.words)
    if found is None and (said := str(table.about.get("started") or "")):
        found = instant(said)
    if found is not None and found.at is not None and found.at.year < _SET:
        found = Start(found.words)
    zone = zone_of(told.zone or "")
    if found is None or zone is None or found.at is None or found.utc is not None:
        return found
    try:
        return replace(found.in_zone(zone), words=f"{found.words}, in {told.zone} as told")
    except ValueError:
        raise ConfigurationError(
            f"{table.path} begins at {found.at}, which {told.zone} has twice or never, as its clocks are set "
            "then: give the offset (--zone +02:00)."
        ) from None


def _of_time(table: Table, number: int, factor: float) -> Start | None:
    """By the first stamp of a column of dates, of seconds since a date, or since 1970."""
    column = table.columns[number]
    finite = column.values[np.isfinite(column.values)]
    if not len(finite):
        return None
    first = factor * float(finite[0])
    if column.since is not None:
        return _after(column.since, first)
    if not (match := EPOCH_NAME.search(column.name)):
        return None
    epoch = {"epoch": LABVIEW_EPOCH} if match[0].lower() == "labview" else {}
    return since_epoch(f"{column.heading} {finite[0]:.15g}", first, **epoch)


def _after(since: Start, seconds: float) -> Start:
    """What begins some time after a clock's zero, and says so."""
    return replace(since.later(seconds), words=since.words + f" and {seconds:g} s" * (seconds != 0))


def _is_apart(start: Start, table: Table, number: int, factor: float) -> bool:
    """True where the time does not begin at zero, so that a date is of its zero or of its first sample.

    Times of day may begin at the start's, too, to the second.
    """
    column = table.columns[number]
    values = factor * column.values[:2] + (column.start_s or 0.0 if column.stamps else 0.0)
    if column.start_s is not None and column.stamps and start.at is not None:
        midnight = start.at.replace(hour=0, minute=0, second=0, microsecond=0)
        off = (values[0] - (start.at - midnight).total_seconds() + 1) % _DAY
        if off <= 2.0:
            return False
    return not abs(values[0]) <= _STEPS * abs(values[-1] - values[0])


def words_of(start: Start) -> str:
    """The sentence on a start."""
    if start.utc is not None:
        return f"It began at {start.utc.isoformat()} ({start.words!r})."
    if start.at is not None:
        return (
            f"It began at {start.at.isoformat()} of a clock whose time zone is not stated ({start.words!r}): "
            "--zone converts it."
        )
    return (
        f"It states {start.words!r}, no clear instant of its first sample, which is kept as it stands there."
    )


def rows_of(starts: Sequence[tuple[int, Start]], first: int) -> tuple[tuple[int, Start], ...]:
    """The starts of a table of which the rows before `first` are left out."""
    before = [(row, start) for row, start in starts if row <= first]
    if not before:
        return ()
    row, start = before[-1]
    return ((0, start if row == first else Start(f"{start.words}, of the whole file")),)
