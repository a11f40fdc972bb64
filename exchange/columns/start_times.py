"""When a measurement began, as its file states it.

A statement is kept in the file's own words, beside the clock time that it means. Only a stated time zone
makes an instant of it: an offset, `Z` or `UTC`, seconds since 1970, or what a format defines (TDMS and NWB).
A date that may be read with the day or with the month first means no clock time, and stays words. Statements
count only under keys that say what began: files name times of export, download and calibration, too.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta, timezone, tzinfo
from zoneinfo import ZoneInfo

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LABVIEW_EPOCH = datetime(1904, 1, 1, tzinfo=UTC)
_EXCEL_DAY = date(1899, 12, 30)
"""Day 0 of a workbook's dates."""
_DATES = (1e8, 6e9)
"""s since 1970 of any recording."""
_YEARS = range(1900, 2200)
"""Of any recording."""
_BEGUN = r"(start(ed|ing|s)?|begin(ning)?|begun|beginn)"
_OF = (
    r"(test|measure(ment)?|record(ing)?|acquisition|acq|capture|data|sample|log(ging)?|session|run|trial|"
    r"mess|prüf)"
)
_WHEN = (
    r"(time ?stamp|date|time|datum|uhrzeit|zeit|at|on|of|[/&]|and|und|test|measurement|recording|data|point)"
)
_KEYS = (
    ("start", rf"({_OF} ?|time coverage )?{_BEGUN}( ?{_WHEN})*"),
    (
        "recorded",
        rf"({_OF}|recorded|measured|acquired|captured|aufnahme|aufzeichnungs)( ?{_WHEN})+|"
        rf"date ((and )?time )?of (the )?{_OF}",
    ),
    (
        "plain",
        r"(date|time|datum|uhrzeit|zeit)( ?([/&]|and|und)? ?(time|uhrzeit|zeit))?( ?stamp)?|t0|exceldatetime",
    ),
    ("trigger", rf"trig(ger)?( ?{_WHEN})+"),
)  # fmt: skip
"""Kinds of keys, the likelier ones to name the first sample before others."""
_UTC = r"(,? ?[(\[]?((utc|gmt)( ?[+-]\d\d:?\d\d|[+-]\d{1,2})?|unix|epoch|posix)[)\]]?)?"
_KEY = tuple(
    (kind, re.compile(rf"{_UTC} ?({key}){_UTC}\s*([:=,;]+|(?=[\s\d])|\Z)", re.I)) for kind, key in _KEYS
)
_ZONE_KEY = re.compile(r"(time[ _]?zone|utc[ _]?offset|zeitzone|tz)\s*[:=]?\s*(?P<zone>\S.*)", re.I)
_ORDER = re.compile(r"date ?format\W*(?P<first>[dm])[dm]?[-/.]", re.I)
"""A form like `M/d/yyyy` that a file gives its dates."""
_JSON = re.compile(r'"(?P<key>[\w /]+)"\s*:\s*"(?P<value>[^"]*)"')
_EPOCH_NUMBER = re.compile(r"(?P<whole>\d{9,10}|\d{12,13}|\d{15,16}|\d{18,19})(\.\d+)?(?!\d)")
"""s, ms, us or ns since 1970, as their digits tell."""
_MARKS = "#%;/!\"'*- \t"
_NAMES = "jan feb mar/mär/mrz apr may/mai jun jul aug sep oct/okt nov dec/dez"
_MONTHS = {name: number for number, names in enumerate(_NAMES.split(), 1) for name in names.split("/")}
_DATE = re.compile(
    r"(?:[A-Za-z]{2,9}\.?,? +)?'?(?:"
    r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})|"
    r"(?P<a>\d{1,2})(?P<sign>[-/.])(?P<b>\d{1,2})(?P=sign)(?P<c>\d{4}|\d\d)|"
    r"(?P<day>\d{1,2})[-. ]+(?P<name>[A-Za-zä]{3})[a-z]*[-., ]+(?P<year>\d{4}|\d\d(?!:))|"
    r"(?P<name2>[A-Za-zä]{3})[a-z]*\.? +(?P<day2>\d{1,2}),? +(?P<year2>\d{4}))(?!\d)"
)
_CLOCK = re.compile(
    r"(?P<h>\d{1,2}):(?P<m>\d{2}|\d(?=:))(?::(?P<s>\d{1,2})(?P<part>(?:[.,:]\d+)*))?"
    r"(?:\s?(?P<half>[AaPp])\.?\s?[Mm]\b\.?)?"
)
"""Before AM and PM, JavaScript and macOS write a narrow blank (U+202F), Spanish `p. m.`."""
_ZONE = re.compile(
    r"(?: ?\(?(?:UTC|GMT))? ?[+-]\d\d:?\d\d(?![\d:])\)?|[+-]\d\d(?![\d.:])|"
    r" ?\(?(?:UTC|GMT)[+-]\d\d?(?![\d.:])\)?|(?: ?\(?(?:UTC|GMT)\)?|Z)(?!\w)"
)
_IN_HEADING = re.compile(r"(?<![a-z])(?:utc|gmt)(?![a-z])(?: ?[+-]\d\d:?\d\d|[+-]\d{1,2})?(?!\d)", re.I)
_SINCE = re.compile(
    r"(?P<at>[\d/.-]+(?P<clock>[T ]+[\d:.]+)?)\s*(?P<zone>(?:UTC|GMT|Z)?\s*(?:[+-]\d{1,2}(?::?\d\d)?)?)\s*"
)
"""As UDUNITS writes an instant: `1992-10-8 15:15:42.5 -6:00`."""
_LETTERS = re.compile(r" ?\(?[A-Z]{3,5}\b\)?")
"""CET, EST, IST: each the name of more than one time zone, so it is kept in the words alone."""
_FARTHEST = timedelta(hours=14)
"""From UTC, of all places."""
_OFFSET = re.compile(r"(?:UTC|GMT|Z)?\s*(?:(?P<sign>[+-])(?P<h>\d{1,2})(?::?(?P<m>\d\d))?)?", re.I)


@dataclass(frozen=True)
class Start:
    """What a file states of the instant at which it began."""

    words: str
    """As the file has them."""
    at: datetime | None = None
    """With a time zone where one is stated, the file's own clock time where none is, None where not clear."""
    exact: bool = False
    """True where the format defines that it is of the first sample, whatever the file's time begins at."""

    @property
    def utc(self) -> datetime | None:
        """The instant, where a time zone is stated."""
        return None if self.at is None or self.at.tzinfo is None else self.at.astimezone(UTC)

    @property
    def contents(self) -> dict[str, str]:
        """The words, and the instant in UTC or the clock time, for a file and a script."""
        found = {"stated": self.words}
        if self.at is not None:
            found |= {"local": self.at.isoformat()} if self.utc is None else {"utc": self.utc.isoformat()}
        return found

    def later(self, seconds: float) -> Start:
        """The start of what begins `seconds` after it."""
        try:
            at = None if self.at is None else self.at + timedelta(seconds=seconds)
        except (OverflowError, ValueError):  # an instant that is none, of a damaged file
            at = None
        return replace(self, at=at if at is not None and at.year in _YEARS else None)

    def in_zone(self, zone: tzinfo) -> Start:
        """With the time zone of a clock time that has none.

        Raises ValueError for a clock time that the zone has twice or never, when its clocks are set.
        """
        if self.at is None or self.at.tzinfo is not None:
            return self
        first, second = (self.at.replace(tzinfo=zone, fold=fold).astimezone(UTC) for fold in (0, 1))
        if first != second:
            raise ValueError(f"{self.at} is no single instant in {zone}")
        return replace(self, at=first)


def zone_of(text: str) -> tzinfo | None:
    """The time zone that a text names, as an offset (`+02:00`, `UTC`) or a place (`Europe/Berlin`)."""
    text = text.strip()
    if text and (match := _OFFSET.fullmatch(text)):
        minutes = 60 * int(match["h"] or 0) + int(match["m"] or 0)
        offset = timedelta(minutes=-minutes if match["sign"] == "-" else minutes)
        return timezone(offset) if abs(offset) <= _FARTHEST else None
    try:
        return ZoneInfo(text) if "/" in text else None
    except (LookupError, OSError, ValueError):
        return None


def since_epoch(words: str, seconds: float, epoch: datetime = EPOCH) -> Start | None:
    """The instant that is stated in s since 1970; None for a number that is none."""
    return Start(words, epoch).later(seconds) if _DATES[0] < seconds < _DATES[1] else None


def instant(text: str, order: str = "", zone: tzinfo | None = None) -> Start | None:
    """The date in a text, with its time of day; None for a text that is none.

    `order` is "d" or "m" where the file says what stands first in its dates, `zone` what it says of them.
    """
    said = _said(text.strip(), order)
    if said is None or not said.dated:
        return None
    found = Start(said.words, said.at)
    with contextlib.suppress(ValueError):
        return found if zone is None else found.in_zone(zone)
    return found


def clock_of(text: str) -> float | None:
    """The time of day (s since midnight) that a text without a date is; None for another."""
    said = _said(text.strip(), "") if text.count(":") > 1 else None
    return None if said is None or said.dated or said.clock is None else said.clock.total_seconds()


def zone_in(heading: str) -> tzinfo | None:
    """The time zone in a heading or a key: `time_utc`, `Date Time, GMT+02:00`."""
    match = _IN_HEADING.search(heading)
    return zone_of(match[0]) if match else None


def order_of(rows: Sequence[Sequence[str]]) -> str:
    """What stands first in the dates of a file that gives their form: "d", "m", or "" without one."""
    return next((m["first"].lower() for row in rows if (m := _ORDER.search(" ".join(row)))), "")


_OUR_CALENDARS = ("", "standard", "gregorian", "proleptic_gregorian")


def since_of(unit: str, calendar: str = "") -> tuple[str, Start | None]:
    """Unit and zero of a time that is counted `seconds since 2026-05-01 10:00`.

    Without a time zone that is in UTC (CF conventions 1.11, chapter 4.4). In another calendar than ours, as
    of 360 days a year (chapter 4.4.1), the words name no instant.
    """
    plain, _, date_ = unit.partition(" since ")
    match = _SINCE.fullmatch(date_.strip())
    if match is None:
        return plain, instant(date_) and Start(unit.strip())
    zone = zone_of(match["zone"]) if match["zone"].strip() else UTC
    since = instant(match["at"] if match["clock"] else f"{match['at']} 00:00", zone=zone)
    ours = calendar.strip().lower() in _OUR_CALENDARS
    return plain, since and Start(unit.strip(), since.at if zone and ours else None)


def zones_of(rows: Sequence[Sequence[str]]) -> tuple[str, tzinfo | None]:
    """The time zone that rows state, in their words, and what it is; of several, none."""
    zones = {m["zone"] for row in rows if (m := _ZONE_KEY.match(" ".join(row).strip(_MARKS)))}
    words = zones.pop() if len(zones) == 1 else ""
    return words, zone_of(words)


def stated_start(rows: Sequence[Sequence[str]], last: bool = False) -> Start | None:
    """What rows of cells, as keys and values, state of the start.

    Where two statements of a kind differ, none is clear; where `last`, the later one holds.
    """
    order = order_of(rows)
    dates: dict[str, _Said] = {}
    clocks: dict[str, _Said] = {}
    unlike = {"trigger"}  # samples begin before their trigger, and how long before is no format's definition
    for kind, key, value in _entries(rows):
        if kind == "plain" and key.lower().startswith("exceldatetime"):
            found = _of_excel(value)
        else:
            found = _said(value, order, zone_in(key))
        if re.search("unix|epoch|posix", key, re.I) and (number := _EPOCH_NUMBER.match(value)):
            digits = len(number["whole"])
            return since_epoch(f"{key} {number[0]}", float(number[0]) / 1000 ** ((digits - 9) // 3))
        if found is None:
            continue
        if kind == "recorded" and not found.dated:
            continue  # a test time of 00:05:30 may be how long it lasted
        found = replace(found, words=f"{key} {found.words}")
        for known, has in ((dates, found.dated), (clocks, found.clock is not None)):
            before = None if last else known.get(kind)
            if has and before is not None and before.differs(found):
                unlike.add(kind)
            if has and (before is None or found.fullness > before.fullness):
                known[kind] = found
    best = _best(dates, clocks, unlike)
    words, zone = zones_of(rows)
    if best is None or best.at is None or zone is None:
        return best
    try:
        return replace(best.in_zone(zone), words=f"{best.words}, {words}")
    except ValueError:
        return best


def _best(dates: dict[str, _Said], clocks: dict[str, _Said], unlike: set[str]) -> Start | None:
    """Of dates and times of day by kind of key, the fullest statement of the likeliest kind."""
    for kind, _ in _KEYS:
        day, clock = dates.get(kind) or dates.get("plain"), clocks.get(kind) or clocks.get("plain")
        if day is None or clock is None or not (kind in dates or kind in clocks):
            continue
        both = _Said(f"{day.words}, {clock.words}", True, day.day, clock.clock, clock.zone or day.zone)
        both = day if day is clock else both
        of = {kind, *({"plain"} if not (kind in dates and kind in clocks) else ())}
        return Start(both.words, None if of & unlike else both.at)
    some = [found.words for kind, _ in _KEYS for found in (dates.get(kind), clocks.get(kind)) if found]
    return Start(some[0]) if some and (dates or "start" in clocks) else None


def _entries(rows: Sequence[Sequence[str]]) -> Iterator[tuple[str, str, str]]:
    """Kind, key and value of each statement: in a line, in JSON, or a heading with its value below it."""
    for number, row in enumerate(rows):
        line = " ".join(cell.strip() for cell in row if cell.strip()).strip(_MARKS)
        pairs = [(m["key"], m["value"]) for m in _JSON.finditer(line)] if "{" in line else []
        below = rows[number + 1] if number + 1 < len(rows) else ()
        pairs += list(zip((cell.strip(_MARKS) for cell in row), below, strict=False))
        for kind, pattern in _KEY:
            spaced = line.replace("_", " ", 4)
            if match := pattern.match(spaced):
                yield kind, match[0].strip(" :=,;"), line[match.end() :].strip(" '\",;")
                break
        for cell, value in pairs:
            for kind, pattern in _KEY:
                if pattern.fullmatch(cell.replace("_", " ")):
                    yield kind, cell, value.strip()
                    break


@dataclass(frozen=True)
class _Said:
    """A date, a time of day, or both, as a text has them."""

    words: str
    dated: bool
    day: date | None
    """None without a date, or for one that is not clear."""
    clock: timedelta | None
    zone: tzinfo | None = None

    @property
    def fullness(self) -> int:
        """How much it states. Midnight beside a date may be no time of day: a workbook's dates have it."""
        return 2 * (self.clock is not None and not (self.dated and not self.clock)) + self.dated

    def differs(self, other: _Said) -> bool:
        """True where both state a day, or a time of day, and not the same."""
        days = None not in (self.day, other.day) and self.day != other.day
        return days or (self.fullness > 1 < other.fullness and self.clock != other.clock)

    @property
    def at(self) -> datetime | None:
        if self.day is None or self.clock is None:
            return None
        return datetime(self.day.year, self.day.month, self.day.day, tzinfo=self.zone) + self.clock


def _said(text: str, order: str, zoned: tzinfo | None = None) -> _Said | None:
    """What a text begins with; None for one that begins with neither date nor time of day.

    `zoned` is the time zone that its key states.
    """
    dated = _DATE.match(text)
    end = dated.end() if dated else 0
    while dated and end < len(text) and text[end] in "T ,;\t":
        end += 1
    clock = _CLOCK.match(text, end)
    if dated is None and clock is None:
        return None
    try:
        day = _day(dated, order) if dated else None
        if day is not None and day.year not in _YEARS:
            return None
        passed = _passed(clock) if clock else None
    except ValueError:  # the 13th month, 25 o'clock
        return None
    end = clock.end() if clock else dated.end() if dated else 0
    letters = _LETTERS.match(text, end)
    zone = _ZONE.match(text, end) if clock else None
    if zone and clock and not clock["s"] and zone[0][0] == "-" and not text[: clock.start()].endswith("T"):
        zone = None  # from 10:00-10:30
    named = zone_of(zone[0].strip(" ()")) if zone else zoned
    end = zone.end() if zone else letters.end() if letters else end
    return _Said(text[:end].strip(), dated is not None, day, passed, named)


def _day(match: re.Match[str], order: str) -> date | None:
    """The day of a date; None for one that may be two. Raises ValueError."""
    if match["y"]:
        return date(int(match["y"]), int(match["m"]), int(match["d"]))
    if match["a"]:
        first, second = int(match["a"]), int(match["b"])
        if match["sign"] == ".":
            order = "d"
        if not order and first != second:
            order = "d" if first > 12 else "m" if second > 12 else ""
        if len(match["c"]) == 2 or not (order or first == second):
            return None
        day, month = (second, first) if order == "m" else (first, second)
        return date(int(match["c"]), month, day)
    name, day_, year = (match[key] or match[f"{key}2"] for key in ("name", "day", "year"))
    if name.lower() not in _MONTHS:
        raise ValueError(name)
    if len(year) == 2:
        return None
    return date(int(year), _MONTHS[name.lower()], int(day_))


def _passed(match: re.Match[str]) -> timedelta:
    """Of a time of day, since midnight. Raises ValueError."""
    hour, minute, second = (int(match[key] or 0) for key in "hms")
    if hour > 23 or minute > 59 or second > 60:
        raise ValueError(match[0])
    if match["half"]:
        hour = hour % 12 + 12 * (match["half"].lower() == "p")
    part = match["part"] or ""
    # Behind a colon three digits are milliseconds; two may be hundredths or frames.
    digits = "" if part.startswith(":") and len(part) != 4 else re.sub(r"\D", "", part)
    return timedelta(hours=hour, minutes=minute, seconds=second, microseconds=int(f"{digits:0<6.6}"))


def _of_excel(value: str) -> _Said | None:
    """A workbook's number of a day, by which the date beside it is clear, whatever its order."""
    number, _, beside = value.partition(" ")
    said = _said(beside.strip(), "")
    try:
        day = _EXCEL_DAY + timedelta(days=int(float(number.replace(",", "."))))
    except (ValueError, OverflowError):
        return said
    return None if said is None else replace(said, day=day)
