"""The instant of the first sample that is imported, of all that a file states of its start.

A column of dates comes before a header, which may name the hour at which a file was made; the clock of a
format's channels comes before it too. Without a stated time zone the clock time is kept as it stands there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...base.errors import ConfigurationError
from ..columns import LABVIEW_EPOCH, Start, Table, instant, since_epoch, zone_of
from .clock import EPOCH_NAME
from .mapping import FileMapping

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
