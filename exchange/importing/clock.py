"""One time base of all that a file states of time: a column of stamps, their unit, and rates.

Stamps are believed before rates, and a rate that contradicts them, or another rate, is asked about. A unit
that no heading states follows from a stated rate, where one unit brings both together; otherwise it is asked.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ...base.arrays import FloatArray
from ..columns import Column, Stated, Table, per_unit, unit_of
from .mapping import FileMapping
from .timebase import TimeBase, time_base
from .understood import Question

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
    if not candidates or (len(candidates) == 1 and not known):
        return (candidates[0], "") if candidates else None
    if known:
        seconds = {n: factor * table.columns[n].values for n, (factor, _) in known.items()}
        finest = max(seconds, key=lambda n: len(np.unique(seconds[n])))
        if all(_same(seconds[finest], one) for one in seconds.values()):
            return finest, "; others tell the same" if len(candidates) > 1 else ""
    names = ", ".join(table.columns[n].heading or str(n) for n in candidates)
    return Question("time", f"which of {names} is the time, for they differ", "--time COLUMN")


def _same(one: FloatArray, other: FloatArray) -> bool:
    """True for stamps that differ by a constant, as far as their digits go."""
    apart = (one - one[0]) - (other - other[0])
    steps = [np.abs(np.diff(v[np.isfinite(v)])) for v in (one, other)]
    fine = max(float(np.min(s[s > 0], initial=np.inf)) for s in steps)
    return bool(np.nanmax(np.abs(apart)) <= fine)


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
