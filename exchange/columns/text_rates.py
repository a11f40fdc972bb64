"""Rates and steps that a file states: in the rows above a text's columns, or by an entry beside arrays.

A rate counts when it is called one of *sampling* (or recording, logging, scanning); baud, bit, slew, press
and heart rates are others'. All statements are returned: which is right, where they differ, is no matter of
order. Dates and times as loggers write them count in seconds from the first.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from datetime import datetime

import numpy as np

from ...base.arrays import FloatArray
from .table import Stated
from .units import unit_of, units_of

_SAMPLED = (
    r"(sampl(e|es|ing|er)?|abtast|mess|(data ?)?log(ging)?|record(ing)?|scan(ning)?|acquisition|acq|daq|"
    r"digiti[sz]ing|storage|aufzeichnungs?|erfassungs?)"
)
_RATE = re.compile(
    rf"(?<![a-z]){_SAMPLED}[ _-]*(rate|freq(uency|\.)?|frequenz|speed|clock)(?![a-z])|"
    r"(?<![a-z])(samples?[ _]*(per|/)[ _]*s(ec(ond)?)?|fs|sps|f_s|rate|sampled at|recorded at)(?![a-z])",
    re.I)  # fmt: skip
_STEP = re.compile(
    rf"(?<![a-z]){_SAMPLED}[ _-]*(interval|period|step|intervall|periode)(?![a-z])|"
    r"(?<![a-z])(delta[ _]?[xt]|[xt][ _]?inc(r|rement)?|increment|dt|hresolution|"
    r"(time|zeit)[ _-]*(step|interval|increment|schritt)|interval|zeitintervall)(?![a-z])",
    re.I)  # fmt: skip
_NOT_OURS = re.compile(
    r"(?<![a-z])(max(imum|\.)?|min(imum|\.)?|original|source|native|up to|possible|supported|available|over|"
    r"baud|bit|slew|press|heart|pulse|strain|frame|refresh|error|ramp|load(ing)?|test|cross|feed|filter|video|"
    r"cut-?off|audio|adc|internal|previous|resampl\w*|flow|cooling|heating|per[ _-]?sample)[ _-]*\Z",
    re.I)  # fmt: skip
"""Words before a rate that make it another's, or none of this file."""
_BESIDE = re.compile(
    r"[\s:=;,\"'(\[{/]*(per channel|of (this )?(file|recording)|in (?=[a-zA-Z/]))?[\s:=;,\"'(\[{/]*"
    r"(?P<unit>[a-zA-Zµμ][a-zA-Zµμ/ ]{0,16}?|)[)\]}\"']*[\s:=;,\"']*"
    r"(?P<number>[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)[\s:\"']*"
    r"(?P<after>[a-zA-Zµμ/][a-zA-Zµμ/0-9^-]*( ?(per|/) ?[a-zA-Z]+)?)?"
)
_DEFINED = {
    "wfincrement": "dt in s",
    "tinterval": "dt in s",
    "sampletime": "dt in s",
    "ts": "dt",
    "sr": "fs",
    "srate": "fs",
    "rate": "sample rate",
}
"""Names of entries that a program defines (LabVIEW, PicoScope, Simulink), or that are short for others."""
_WORD = re.compile(r"(?<=[a-z])(?=[A-Z])|[ _.-]+")
"""Between the words of an entry's name: `sampleRate_Hz`."""
_PER_SAMPLE = re.compile(r"(?P<number>\d[\d.,]*) ?(?P<unit>[mµu]?s(ec)?) ?/ ?sample(?![a-z])", re.I)
"""Of AcqKnowledge."""
_SECTION = re.compile(r"(devices|trajectories|model outputs|joints|segments|analog|emg)\Z", re.I)
"""Of Vicon's tables, below whose name the rate stands."""
_CELL = " : "
"""Between the cells of a row."""


def stated_rates(rows: Sequence[Sequence[str]], decimal: str, seconds: float | None) -> tuple[Stated, ...]:
    """The rates that rows of cells state, each once; `seconds` is the file's unit of its horizontal axis."""
    found: dict[float | str, Stated] = {}
    for number, row in enumerate(rows):
        below = rows[number + 1] if number + 1 < len(rows) else ()
        for one in (*_in_row(row, below, decimal, seconds), *_of_program(row, below, decimal)):
            found.setdefault(one.words if one.hz is None else one.hz, one)
    return tuple(found.values())


def stated_by(name: str, value: float) -> Stated | None:
    """What an entry of a file states by its name (`sample_rate_hz`, `dtMs`); None for other things."""
    plain = re.sub(r"[^a-z0-9]", "", name.lower())
    words = _DEFINED.get(plain) or " ".join(filter(None, _WORD.split(name)))
    if not 0 < value < float("inf"):
        return None
    found = _in_row([words, f"{value!r}"], (), ".", None)
    return replace(found[0], words=f"{name} = {value:g}") if found else None


def _in_row(row: Sequence[str], below: Sequence[str], decimal: str, seconds: float | None) -> list[Stated]:
    line = _CELL.join(cell.strip() for cell in row if cell.strip())
    found = []
    for pattern, is_step in ((_RATE, False), (_STEP, True)):
        for match in pattern.finditer(line):
            if _NOT_OURS.search(line[: match.start()]):
                continue
            beside = _BESIDE.match(line, match.end())
            if beside is not None:
                found += _stated(match[0], line, beside, is_step, decimal, seconds)
    for place, cell in enumerate(row):  # a heading with its value below it
        whole = (_STEP.match(cell.strip()) or _RATE.match(cell.strip())) if cell.strip() else None
        if (
            whole is None
            or place >= len(below)
            or (place + 1 < len(row) and _number(row[place + 1], decimal))
        ):
            continue
        rest = cell.strip()[whole.end() :]
        if (
            re.fullmatch(r"\s*([(\[].{1,12}[)\]])?", rest)
            and _number(below[place].strip(), decimal) is not None
        ):
            beside = _BESIDE.match(f"{rest} {below[place].strip()}")
            if beside is not None:
                is_step = _STEP.match(cell.strip()) is not None
                said = f"{cell.strip()} {below[place].strip()}"
                found += _stated(whole[0], said, beside, is_step, decimal, seconds)
    return found


def _of_program(row: Sequence[str], below: Sequence[str], decimal: str) -> list[Stated]:
    """A rate as single programs state it."""
    cells, under = ([cell.strip() for cell in one if cell.strip()] for one in (row, below))
    if len(cells) == 1 and _SECTION.match(cells[0]) and under and under[1:] in ([], ["Hz"]):
        hz = _number(under[0], decimal)
        return [Stated(hz, f"{cells[0]} {under[0]}")] if hz is not None and hz > 0 else []
    match = _PER_SAMPLE.match(" ".join(cells))
    unit = unit_of(match["unit"], "time") if match else None
    number = _number(match["number"], decimal) if match else None
    return [Stated.step(number * unit.factor, match[0])] if match and unit and number else []


def _stated(
    key: str, line: str, beside: re.Match[str], is_step: bool, decimal: str, seconds: float | None
) -> list[Stated]:
    """What a key, its number and the units beside it state; nothing where they are of another kind."""
    value = _number(beside["number"], decimal)
    said = f"{key}{beside[0]}".replace(_CELL, " ").strip(" ,;")
    after = "" if beside["number"].endswith(",") else (beside["after"] or "").strip()  # JSON's next entry
    units = [u for u in (beside["unit"].strip(), after) if u]
    known = [u for text in units for q in ("rate", "time") if (u := unit_of(text, q)) is not None]
    others = [text for text in units if units_of(text) and not any(
        unit_of(text, q) for q in ("rate", "time"))]  # fmt: skip
    bare = key.lower() in ("rate", "interval", "increment", "fs", "sps", "f_s", "dt")
    if others or (bare and units and not known) or (key.lower() in ("rate", "interval") and not known):
        return []  # in mm/s, of another thing
    if beside["unit"].strip() and not known:
        return []  # words between: `sample rate divider 4`
    if value == 0:
        return []
    end = beside.end("number")
    several = {
        v for cell in line[end:].split(_CELL)[1:]
        if (v := _number(cell.strip(), decimal)) is not None
    }  # fmt: skip
    # 100,000 Hz in a file with commas between columns; another number of each channel; two units
    cut = _CELL not in line[beside.start() : end] and re.match(r" : \d{3}(?![\d.])", line[end:])
    if value is None or value < 0 or cut or several - {value} or len({u.factor for u in known}) > 1:
        return [Stated(None, line.replace(_CELL, " ")[:60])]
    hz = None
    if known:
        seconds = known[0].factor
        hz = value * seconds if known[0].quantity == "rate" else 1 / (value * seconds)
    elif not units and is_step:
        hz = None if seconds is None else 1 / (value * seconds)
    elif not units and value >= 1:
        hz = value  # samples per second is what a sample rate is, but one below 1 is a step in some unit
    return [Stated(hz if hz is None else float(f"{hz:.9g}"), said, value)]


def _number(text: str, decimal: str) -> float | None:
    """A number with its decimal sign, or groups of thousands; None for one that could be two numbers."""
    whole = re.fullmatch(r"[-+]?(?P<digits>\d[\d.,]*)(?P<power>[eE][-+]?\d+)?", text.rstrip(",."))
    if whole is None:
        return None
    plain, other = text.rstrip(",."), "," if decimal == "." else "."
    if other in plain:
        grouped = re.fullmatch(rf"[-+]?[1-9]\d{{0,2}}(\{other}\d{{3}})+(\{decimal}\d*)?", plain)
        several = plain.count(other) > 1 or decimal in plain
        if grouped is None:
            if several:
                return None
            plain = plain.replace(other, ".")  # 0,2 in a file with decimal points: what else could it be
        elif decimal == "," and not several:
            return None  # 5.000
        else:
            plain = plain.replace(other, "")
    try:
        return float(plain.replace(",", "."))
    except ValueError:
        return None


_CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2}):(?P<s>\d{2}(?:[.,]\d+|:\d{3})?)\s*(?P<half>[AaPp]\.?\s?[Mm]\.?)?"
_STAMPS = tuple(
    re.compile(rf"\s*{day}{between}(?:{_CLOCK})?\s*(?:Z|UTC|(?P<offset>[+-]\d\d:?\d\d))?\s*\Z")
    for day, between in (
        (r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})", r"[T ]?\s*"),
        (r"(?P<day>\d{1,2})\.(?P<month>\d{1,2})\.(?P<year>\d{4})", r"[T ,]?\s*"),
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
    matches = [(row, match) for row, text in enumerate(texts) if (match := kind.match(text))]
    dated = kind in _STAMPS
    days = _days({_day_of(match) for _, match in matches}) if dated else {}
    found = np.full(len(texts), np.nan)
    for row, match in matches:
        said = match.groupdict()
        clock = _DAY * days[_day_of(match)] if dated else 0.0
        if said["s"] is not None:
            hour = int(said.get("h") or 0)
            if said.get("half"):
                hour = hour % 12 + 12 * (said["half"][0].lower() == "p")
            clock += _HOUR * hour + 60.0 * int(said["m"]) + float(re.sub("[,:]", ".", said["s"]))
        if offset := said.get("offset"):  # which changes in the hour in which clocks are set
            clock -= float(f"{offset[0]}1") * (_HOUR * int(offset[1:3]) + 60.0 * int(offset[-2:]))
        found[row] = clock + _DAY * int(said.get("days") or 0)
    there = np.flatnonzero(np.isfinite(found))
    if not len(there):
        return found
    if kind in (_TIME, _MINUTES):
        period = _DAY if kind is _TIME else _HOUR
        found[there] += period * np.cumsum(np.concatenate([[0], np.diff(found[there]) < -period / 2]))
    return np.asarray(found - found[there[0]])


def _day_of(match: re.Match[str]) -> tuple[str, str, str]:
    return match["year"], match["month"], match["day"]


def _days(keys: Collection[tuple[str, str, str]]) -> dict[tuple[str, str, str], float]:
    """Days from the first of year, month and day, NaN for what is none.

    Of day and month, that stands first with which the days are nearest to each other: a measurement over
    midnight is of two neighbours.
    """
    best: dict[tuple[str, str, str], float] = {}
    for form in ("%Y-%m-%d", "%Y-%d-%m", "%Y-%b-%d"):
        found = {}
        for key in keys:
            with contextlib.suppress(ValueError):
                found[key] = datetime.strptime("-".join(key), form).toordinal()
        first, last = min(found.values(), default=0), max(found.values(), default=0)
        if (len(found), first - last) > (len(best), -max(best.values(), default=0.0)):
            best = {key: float(day - first) for key, day in found.items()}
    return {key: best.get(key, float("nan")) for key in keys}
