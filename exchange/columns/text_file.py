"""Text files: CSV and its relatives, of spreadsheets, LabVIEW, oscilloscopes, recorders and loggers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import DataError
from ..views import read_sidecar
from .start_times import Start, clock_of, instant, since_epoch, stated_start, zone_in
from .table import Column, Labels, Stated, Table, together
from .text_cells import decoded, is_blank, is_number, measured, plain_number
from .text_head import Head, beside, enter_unit, head_of
from .text_rates import is_stamp, seconds_of, stated_rates, unclear
from .text_rows import Body, body_of
from .units import Unit, is_time, unit_of, units_of

_LABELLED = re.compile(
    r"([A-Za-z][\w ]*?)\s?[:=]\s*([-+]?\d+\.?\d*(?:[eE][-+]?\d+)?)"
    r"(?: ?(m?N|k?gf?|lb[sf]?|ozf?|m?V|[mu]?m|[mu]?s))?(?=[\s,;|]|\Z)"
)
"""Label, number and unit, as sketches print: `Reading: 0.1 lbs calibration_factor: -7050.00`."""
_MONITOR = re.compile(r"(\d{1,2}:\d{2}:\d{2}[.,:]\d+)\s*->\s?")
"""The Arduino IDE's stamp before a line."""
_LVM_END = re.compile(r"^\*\*\*End_of_Header\*\*\*.*$", re.M)
_UNIT_COLUMN = re.compile(r"(.*[ _])?(units?|einheit(en)?)(?![a-z]).*", re.I)
"""Headings of a column of units, beside that of their numbers."""
_LEVELS: tuple[dict[str, float], ...] = (
    {"false": 0.0, "true": 1.0}, {"open": 0.0, "closed": 1.0}, {"off": 0.0, "on": 1.0},
    {"low": 0.0, "high": 1.0},
)  # fmt: skip
"""Words for the two levels of a contact."""
_COUNT = re.compile(
    r"(?<![a-z])(npts|n_?rows|data ?rows|(record|memory) ?(length|count)|(num(ber)?[. _]*(of )?)?(data ?)?"
    r"(samples|points|scans|rows))(?![a-z])[^a-z0-9+-]{0,12}(?P<count>\d+(\.\d*)?(e\+?\d+)?)(?![\d:.])"
    r"(?! ?[a-z%/])",
    re.I)  # fmt: skip
"""How many samples there are."""
_DIVISIONS = 20.0
"""Of a screen, with room for offsets: ten are usual."""
_FEWEST = 10
"""Rows of a file whose first two are told apart from samples."""
_FASTEST, _SMALL = 1e5, 1e-3
"""Hz, and the largest sample over a start: neither is a column of times."""
_MOST_HEAD = 2000
"""Rows above the columns in which rates are looked for."""


def read_table(path: Path, decimal: str | None, skip: bool = False) -> Table:
    """Read a file's columns; `decimal` is the decimal sign, if it was told. Raises DataError.

    Damaged rows are left out where `skip` says so, and their numbers kept.
    """
    try:
        text = _plain(decoded(path))
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}.") from None
    parts = [table_of(path, body_of(path, one, decimal, skip)) for one in _segments(text)]
    return replace(_joined(path, parts), about=read_sidecar(path).get("about", {}))


def _plain(text: str) -> str:
    """A text without what stands in each line besides cells: stamps of a monitor, labels of a plotter."""
    head = text[:100_000].splitlines()
    middle = next((line for line in head[len(head) // 2 :] if line.strip()), "")
    if _MONITOR.match(middle):
        rest = _MONITOR.sub("", middle)
        separator = next((sign for sign in "\t;,|" if sign in rest), " " if " " in rest.strip() else ",")
        return re.sub(rf"^{_MONITOR.pattern}", rf"\1{separator}", text, flags=re.M)
    labels = _LABELLED.findall(middle)
    if not labels or _LABELLED.sub("", middle).strip(" ,;|\t"):
        return text
    headings = [(label, unit) for label, _, unit in labels]
    rows = []
    for line in text.splitlines():
        found = _LABELLED.findall(line)
        same = [(label, unit) for label, _, unit in found] == headings
        rows.append("\t".join(value for _, value, _ in found) if same else line)
    first = "\t".join(f"{label} [{unit}]" if unit else label for label, unit in headings)
    return "\n".join([first, *rows, ""])


def _segments(text: str) -> list[str]:
    """A text, or each segment of a LabVIEW measurement with the file's header before it."""
    ends = list(_LVM_END.finditer(text)) if text.startswith("LabVIEW Measurement") else []
    if len(ends) < 3:
        return [text]
    header = text[: ends[0].end()]
    begins = [ends[0].end()]
    for one in ends[2:]:  # the header of a segment begins behind the last blank line
        begins.append(
            text.rfind("\n\n", begins[-1], one.start()) + 1 or text.rfind("Channels", 0, one.start())
        )
    parts = [text[a:b] for a, b in zip(begins, [*begins[1:], len(text)], strict=True)]
    return [f"{header}\n{part.strip()}\n" for part in parts]


def _joined(path: Path, parts: Sequence[Table]) -> Table:
    """Segments below each other, and a column that says which is which."""
    first = parts[0]
    if len(parts) == 1:
        return first
    if len({tuple(c.heading for c in part.columns) for part in parts}) > 1:
        raise DataError(
            f"{path} holds {len(parts)} segments, measured one after another, with other columns each: save "
            "each in a file of its own."
        )
    columns = tuple(
        replace(column, values=np.concatenate([part.columns[n].values for part in parts]))
        for n, column in enumerate(first.columns)
    )
    numbers = tuple(str(n) for n, part in enumerate(parts, 1) for _ in part.columns[0].values)
    rates = tuple(dict.fromkeys(rate for part in parts for rate in part.rates))
    notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
    kind = f"{first.kind}, {len(parts)} segments"
    above = np.cumsum([0, *(len(part.columns[0].values) for part in parts)]).tolist()
    starts = tuple((row, start) for row, part in zip(above, parts, strict=False) for _, start in part.starts)
    damaged = tuple(begin + row for begin, part in zip(above, parts, strict=False) for row in part.damaged)
    return replace(
        first, kind=kind, columns=columns, rates=rates, notes=notes, labels=(Labels("segment", numbers),),
        damaged=damaged, starts=starts,
    )  # fmt: skip


def table_of(path: Path, body: Body) -> Table:
    """The columns of rows, with what the rows above them say. Raises DataError."""
    above = [[cell.strip() for cell in row] for row in body.above]
    head = head_of(path, body, above)
    if any("t0 =" in " ".join(row) or {"Start", "Increment"} <= set(row) for row in above[-2:]):
        head.seconds = head.seconds or 1.0  # Rigol's increments
    stated = [[cell.strip("#%;/!") for cell in row] for row in above[-_MOST_HEAD:]]
    rates = stated_rates([*stated, *beside(body)], body.decimal, head.seconds)
    of_units = _unit_columns(body, head)
    columns = _columns(path, body, head, of_units)
    notes = _complete(path, body, head, [*stated, *beside(body)], len(columns[0].values))
    start = _start(head, stated)
    left = 0
    if len(columns) > 2 and not head.names and all(c.values[0] == n for n, c in enumerate(columns)):
        left = 1
        notes.append("Its first row (0, 1, 2, ...) numbers its columns, and was left out.")
    elif not head.names and (first := _of_empatica(columns)) is not None:
        left, (start, rate) = 2, first
        rates = (*rates, rate)
        notes.append("Its first two rows state its start and its rate, and were left out.")
    elif _are_counts(columns, rates):
        left = 1
        notes.append("Its first row states how many samples each channel has, and was left out.")
    columns = [replace(column, values=column.values[left:]) for column in columns]
    if head.starts and len(rates) == 1:
        columns, moved = together(path, [replace(column, rate_hz=rates[0].hz) for column in columns])
        notes += moved
    lines = f", the first row of numbers is line {len(above) + 1}" if above else ", no headings"
    return Table(
        path, body.shape + lines, tuple(columns), rates, notes=(*head.notes, *body.notes, *notes),
        labels=tuple(replace(one, texts=one.texts[left:]) for one in _labels(body, head, of_units)),
        damaged=tuple(row - left for row in body.damaged if row >= left),
        starts=() if start is None else ((0, start),),
    )  # fmt: skip


def _start(head: Head, stated: Sequence[Sequence[str]]) -> Start | None:
    """What the rows above say of the start; of LabVIEW's, the instant of the first sample, which X0 is after
    the date (Specification for the LabVIEW Measurement File, NI 4139).
    """
    found = stated_start(stated, head.labview)
    after = max(head.starts.values(), default=0.0)
    if found is None or not head.labview:
        return found
    return replace(found.later(after), words=found.words + f", X0 {after:g} s" * (after != 0), exact=True)


def _of_empatica(columns: Sequence[Column]) -> tuple[Start, Stated] | None:
    """The start and the rate that an Empatica E4 writes as the first two samples of each column."""
    if any(len(column.values) < _FEWEST or column.stamps for column in columns):
        return None
    first, second = ({float(column.values[row]) for column in columns} for row in (0, 1))
    if len(first) > 1 or len(second) > 1:
        return None
    (seconds,), (hz,) = first, second
    start = since_epoch(f"{seconds:.15g} in its first row", seconds)
    most = max(float(np.nanmax(np.abs(column.values[2:]), initial=0.0)) for column in columns)
    if start is None or not 0 < hz <= _FASTEST or most > _SMALL * seconds:
        return None
    return start, Stated(float(f"{hz:.9g}"), f"{hz:g} in its second row")


def _are_counts(columns: Sequence[Column], rates: Sequence[Stated]) -> bool:
    """True for the first row of AcqKnowledge's text, which a time has nothing in."""
    first = [float(c.values[0]) for c in columns if np.isfinite(c.values[0])]
    rows = len(columns[0].values) - 1
    known = any("/sample" in rate.words.replace(" ", "") for rate in rates)
    whole = all(1 <= one <= max(first) and one.is_integer() for one in first)
    return bool(known and first and whole and abs(max(first) - rows) <= max(_FEWEST, 0.001 * rows))


def _complete(path: Path, body: Body, head: Head, stated: Sequence[Sequence[str]], rows: int) -> list[str]:
    """A sentence where a text states more samples than it has rows.

    Raises DataError for samples that stand beside each other.
    """
    found = {int(float(one["count"])): one[0] for row in stated for one in _COUNT.finditer(" ".join(row))}
    count, words = next(iter(found.items()), (0, ""))
    width = len(body.columns)
    if len(found) != 1 or count <= rows:
        return []
    if not head.names and width > 1 and rows * width <= count < (rows + 1) * width:
        raise DataError(
            f"{path} states {words!r} and has {rows} rows of {width}: its samples stand beside each other, "
            "so write one to a row."
        )
    return [f"{words!r} is stated, and there are {rows} rows: its end may be missing."]


def _beyond(head: Head, place: int, values: FloatArray) -> str:
    """The doubt of numbers that no screen of the stated divisions shows: an oscilloscope's counts."""
    span, one = float(np.ptp(values)) if len(values) else 0.0, head.divisions.get(place, np.inf)
    if not span > _DIVISIONS * one > 0:
        return ""
    unit = head.units.get(place, "")
    return f"{one:g} {unit} a division are stated, and it spans {span:g}, as counts do"


def _unit_columns(body: Body, head: Head) -> dict[int, list[str]]:
    """By place of a column of numbers: the unit of each row, where the column behind it is one of units."""
    found = {}
    for place in range(1, len(body.rows[0]) if body.rows else 0):
        heading = head.names.get(place, "")
        if place in body.columns or place - 1 not in body.columns:
            continue
        units = [row[place].strip() for row in body.rows]
        called = not heading or _UNIT_COLUMN.fullmatch(heading)
        if called and any(units) and all(units_of(unit) for unit in dict.fromkeys(units) if unit):
            found[place - 1] = units
    return found


def _in_one_unit(path: Path, head: Head, place: int, values: FloatArray, units: Sequence[str]) -> FloatArray:
    """Values whose rows each state a unit, in the first of these, which is entered as the column's.

    Raises DataError for units of different quantities.
    """
    there = np.isfinite(values)
    said = list(dict.fromkeys(unit for unit, has in zip(units, there, strict=True) if has))
    unit = next((one for one in said if one), "")
    if not unit:
        return values
    first = {one.quantity: one.factor for one in units_of(unit)}
    ratios = {}
    for one in filter(None, said):
        own: tuple[Unit, ...] = units_of(one)
        if {each.quantity for each in own} != set(first):
            name = head.names.get(place, "") or f"column {place}"
            raise DataError(
                f"{path} gives {name} in {unit} in some rows and in {one} in others, which are different "
                "quantities: save each in a column of its own."
            )
        ratios[one] = own[0].factor / first[own[0].quantity]
    if "" in said:
        head.doubts[place] = f"some of its rows say {unit}, others nothing"
    elif len(ratios) > 1:
        head.notes.append(f"Rows in {', '.join(ratios)} were all brought to {unit}.")
    enter_unit(head, place, unit, "each of its rows")
    return np.asarray(values * np.array([ratios.get(one, 1.0) for one in units]))


def _columns(path: Path, body: Body, head: Head, of_units: Mapping[int, list[str]]) -> list[Column]:
    def column(place: int, values: FloatArray, stamps: bool = False) -> Column:
        unit = "" if stamps else head.units.get(place, "")
        return Column(
            head.names.get(place, ""), unit, values, start_s=head.starts.get(place), stamps=stamps,
            doubt=head.doubts.get(place, "") or _beyond(head, place, values), also=head.also.get(place, ()),
        )  # fmt: skip

    if body.values is not None:
        return [column(place, _finite(body.values[:, place])) for place in body.columns]
    if not body.rows:
        raise DataError(f"{path} has no row of numbers.")
    found: list[Column] = []
    stamped: list[tuple[Column, list[str]]] = []
    for place in body.columns:
        cells = [row[place] for row in body.rows]
        one = next((cell for cell in cells if not is_blank(cell)), "")
        if doubt := unclear(cells):
            if _is_timed(head, place):
                unit = head.units.get(place, "")
                values = seconds_of(cells)
                found.append(replace(column(place, values), doubt="" if unit_of(unit, "time") else doubt))
        elif is_stamp(one) and not is_number(one, body.decimal):
            own = column(place, seconds_of(cells), stamps=True)
            zone = zone_in(" ".join(own.also)) or head.zone
            own = replace(own, since=instant(one, head.order, zone), start_s=clock_of(one))
            stamped.append((own, cells))
        else:
            try:
                values, units = _numbers(cells, body.decimal)
            except ValueError as error:  # a time among numbers
                name = head.names.get(place, "") or f"column {place}"
                raise DataError(f"{path} has more than numbers in {name} ({error}): repair it.") from None
            units = units or of_units.get(place, [])
            found.append(column(place, _in_one_unit(path, head, place, values, units) if units else values))
    for place in range(len(body.rows[0])):
        words = {row[place].strip().lower() for row in body.rows} - {""}
        if place not in body.columns and (
            levels := next((one for one in _LEVELS if words == set(one)), None)
        ):
            closed = [levels.get(row[place].strip().lower(), float("nan")) for row in body.rows]
            found.append(column(place, np.array(closed)))
    return _one_stamp(stamped, found, head)


def _is_timed(head: Head, place: int) -> bool:
    """Under such a heading, or none, 12:04 is a time of each row, and no name of some."""
    name = head.names.get(place, "")
    return not name or is_time(name, head.units.get(place, ""))


def _numbers(cells: Sequence[str], decimal: str) -> tuple[FloatArray, list[str]]:
    """(rows,) with NaN for a blank, and the unit that each row states; no units where none does."""
    plain = [cell.replace(",", ".") for cell in cells] if decimal == "," else cells
    try:
        return _finite(np.array(plain, dtype=np.float64)), []
    except ValueError:
        pairs = [measured(cell, decimal) or (cell, "") for cell in cells]
        values = np.array(
            [np.nan if is_blank(one) else float(plain_number(one, decimal)) for one, _ in pairs]
        )
        units = [unit for _, unit in pairs]
        return _finite(values), units if any(units) else []


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _one_stamp(stamped: Sequence[tuple[Column, list[str]]], others: list[Column], head: Head) -> list[Column]:
    """Of a date and a time of day in a column each, one instant; with a column of their milliseconds, too."""
    dates = [one for one in stamped if not any(":" in cell for cell in one[1][:10])]
    clocks = [one for one in stamped if one not in dates]
    found = [column for column, _ in stamped]
    if len(dates) == len(clocks) == 1:
        (day, days), (clock, times) = dates[0], clocks[0]
        both = [f"{d.strip()} {t.strip()}" for d, t in zip(days, times, strict=True)]
        values = seconds_of(both) if all(map(is_stamp, both[:10])) else clock.values
        zone = zone_in(" ".join((*clock.also, *day.also))) or head.zone
        since = instant(next((text for text in both if is_stamp(text)), ""), head.order, zone)
        found = [Column(f"{day.name} {clock.name}".strip(), "", values, stamps=True, since=since)]
    if len(found) == 1 and not np.any(np.diff(found[0].values[np.isfinite(found[0].values)]) % 1):
        for part in [column for column in others if column.name.lower() in ("ms", "us", "msec", "usec")]:
            unit = unit_of(part.name, "time")
            if unit is not None and 0 <= np.nanmin(part.values) <= np.nanmax(part.values) < 1 / unit.factor:
                name = f"{found[0].name} {part.name}".strip()
                fine = found[0].values + unit.factor * part.values
                found = [replace(found[0], name=name, also=(), values=fine)]
                others = [column for column in others if column is not part]
                break
    return [*found, *others]


def _labels(body: Body, head: Head, of_units: Mapping[int, list[str]]) -> list[Labels]:
    """Columns of text."""
    found = []
    width = len(body.rows[0]) if body.rows else 0
    for place in range(width):
        texts = tuple(row[place].strip() for row in body.rows)
        named = place not in body.columns or (unclear(texts) and not _is_timed(head, place))
        if not named or place - 1 in of_units:
            continue
        words = {text.lower() for text in texts} - {""}
        if words and not any(words == set(one) for one in _LEVELS):
            found.append(Labels(head.names.get(place, "") or f"column {place}", texts))
    return found
