"""Dates and times as loggers write them, in seconds from the first."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from datetime import date, datetime

import numpy as np

from ...base.arrays import FloatArray

_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2}(?:[.,]\d+|:\d{3})?)\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
_STAMPS = tuple(
    re.compile(rf"\s*{day}{between}(?:{_CLOCK})?\s*(?:Z|UTC|[+-]\d\d:?\d\d)?\s*\Z")
    for day, between in (
        (r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})", r"[T ]?\s*"),
        (r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})", r"[T ,]?\s*"),
        # Month first, as in the United States; the other way round only a day's change would be wrong.
        (r"(?P<month>\d{1,2})/(?P<day>\d{1,2})/(?P<year>\d{4})", r"[T ,]?\s*"),
        (r"(?P<day>\d{1,2})[- ](?P<month>[A-Z][a-z]{2})[- ](?P<year>\d{4})", r"[T ,]?\s*"),
    )
)
_SPAN = re.compile(rf"\s*(?P<days>-?\d+) days?,? (?:\+)?{_CLOCK}\s*\Z")
"""As pandas writes a time since the start."""
_TIME = re.compile(rf"\s*{_CLOCK}\s*\Z")
_MINUTES = re.compile(r"\s*(?P<m>\d{1,3}):(?P<s>[0-5]\d(?:[.,]\d+)?)\s*\Z")
"""As spreadsheets write a time by default (mm:ss.0), without its hours; without a fraction, see `unclear`."""
_ISO = re.compile(r"\s*\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d{1,9})?\s*\Z")
_DAY, _HOUR = 86_400.0, 3600.0


_CLOCKS = (_SPAN, _TIME, _MINUTES)


def is_stamp(text: str) -> bool:
    """True for a date, a time of day, or both."""
    if any(s.match(text) for s in _STAMPS):
        return True
    return ":" in text and any(s.match(text) for s in _CLOCKS)


def unclear(texts: Sequence[str]) -> str:
    """Of times like 12:04, which may be mm:ss or hh:mm: this doubt; "" where a fraction says mm:ss."""
    one = next((text for text in texts if any(map(str.isdigit, text))), "")
    if not _MINUTES.match(one) or any("." in text or "," in text for text in texts):
        return ""
    return f"{one.strip()} may be mm:ss or hh:mm"


def seconds_of(texts: Sequence[str]) -> FloatArray:
    """(rows,) s from the first; NaN for another text.

    A time of day that goes back begins another day, one without hours another hour. Times that are `unclear`
    are taken as mm:ss.
    """
    with contextlib.suppress(ValueError):  # ISO 8601, quickly
        if texts and _ISO.match(texts[0]):
            instants = np.array([text.strip().replace(" ", "T") for text in texts], dtype="datetime64[ns]")
            if not np.isnat(instants).any():
                return np.asarray((instants - instants[0]) / np.timedelta64(1, "ns") * 1e-9)
    one = next((text for text in texts if is_stamp(text)), "")
    kind = next((s for s in (*_STAMPS, *_CLOCKS) if s.match(one)), _TIME)
    days: dict[tuple[str, str, str], float] = {}
    found = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        match = kind.match(text)
        if match is None:
            continue
        said = match.groupdict()
        clock = 0.0
        if said["s"] is not None:
            hour = int(said.get("h") or 0)
            if said.get("half"):
                hour = hour % 12 + 12 * (said["half"][0].lower() == "p")
            clock = _HOUR * hour + 60.0 * int(said["m"]) + float(re.sub("[,:]", ".", said["s"]))
        if "year" in said:
            key = (said["year"], said["month"], said["day"])
            if key not in days:
                days[key] = _ordinal(*key) * _DAY
            clock += days[key] - next(iter(days.values()))
        found[row] = clock + _DAY * int(said.get("days") or 0)
    there = np.flatnonzero(np.isfinite(found))
    if not len(there):
        return found
    if kind in (_TIME, _MINUTES):
        period = _DAY if kind is _TIME else _HOUR
        found[there] += period * np.cumsum(np.concatenate([[0], np.diff(found[there]) < -period / 2]))
    return np.asarray(found - found[there[0]])


def _ordinal(year: str, month: str, day: str) -> float:
    for form in ("%Y-%m-%d", "%Y-%d-%m", "%Y-%b-%d"):  # the 20th month: the day stands first
        try:
            found: date = datetime.strptime(f"{year}-{month}-{day}", form)
        except ValueError:
            continue
        return float(found.toordinal())
    return float("nan")
