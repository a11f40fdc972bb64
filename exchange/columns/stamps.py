"""Dates and times as loggers write them, in seconds from the first."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from ...instruments.arrays import FloatArray

_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2}(?:[.,]\d+)?)\s*(?P<half>[AaPp][Mm])?"
_STAMPS = tuple(
    re.compile(rf"\s*{day}{between}(?:{_CLOCK})?\s*(?:Z|[+-]\d\d:?\d\d)?\s*\Z")
    for day, between in (
        (r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})", r"[T ]?\s*"),
        (r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})", r"[T ,]?\s*"),
        # Month first, as in the United States; the other way round only a day's change would be wrong.
        (r"(?P<month>\d{1,2})/(?P<day>\d{1,2})/(?P<year>\d{4})", r"[T ,]?\s*"),
    )
)
_TIME = re.compile(rf"\s*{_CLOCK}\s*\Z")
_DAY = 86_400.0


def is_stamp(text: str) -> bool:
    """True for a date, a time of day, or both."""
    return (":" in text and _TIME.match(text) is not None) or any(s.match(text) for s in _STAMPS)


def seconds_of(texts: Sequence[str]) -> FloatArray:
    """(rows,) s from the first; a time of day that goes back begins another day. NaN for another text."""
    kind = next((s for s in (*_STAMPS, _TIME) if texts and s.match(texts[0])), _TIME)
    days: dict[tuple[str, str, str], float] = {}
    found = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        match = kind.match(text)
        if match is None:
            continue
        said = match.groupdict()
        clock = 0.0
        if said["h"] is not None:
            hour = int(said["h"])
            if said["half"]:
                hour = hour % 12 + 12 * (said["half"].lower() == "pm")
            clock = 3600.0 * hour + 60.0 * int(said["m"]) + float(said["s"].replace(",", "."))
        if "year" in said:
            key = (said["year"], said["month"], said["day"])
            if key not in days:
                days[key] = _ordinal(*map(int, key)) * _DAY
            clock += days[key] - next(iter(days.values()))
        found[row] = clock
    if "year" not in kind.groupindex and len(found):
        found += _DAY * np.cumsum(np.concatenate([[0], np.diff(found) < -_DAY / 2]))
    return np.asarray(found - found[0]) if len(found) else found


def _ordinal(year: int, month: int, day: int) -> float:
    try:
        return float(date(year, month, day).toordinal())
    except ValueError:  # the 20th month: the day stands first
        try:
            return float(date(year, day, month).toordinal())
        except ValueError:
            return float("nan")
