"""Recorded along: numbers and files as events, and streams with the time of each of their samples.

Three steps lead from a stamp to a time of the recording. A line through the measured corrections leads from
the sender's clock to LSL's clock of the recording computer; a line through the pairs of the file's stream
`CLOCK` from there to the rig's clock; and the blocks' arrivals on the rig's clock tell which sample of the
recording was taken then. Crystals are steady within minutes, so each is a line, robust against single
measurements that a busy computer or network has delayed.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...base.arrays import FloatArray
from ...base.entry_points import optional
from ...base.errors import DataError
from ...base.files import beside
from ...instruments import NewFile, Reading
from ...instruments.streams import CLOCK
from .rows import EVENT, Event

# Numbers and files recorded along, stored as events of a recording.
#
# An event's text has a limited length and is part of the recording's hash. The event of a file states its
# name and SHA-256, so that a later replacement of the file is detected.

_LONGEST = EVENT["text"].itemsize


class AlongReading(NamedTuple):
    """A number read from an instrument while recording."""

    sample: int
    """Number of samples recorded at the time of the request."""
    instrument: str
    """Its role in the rig file."""
    name: str
    value: float
    unit: str


class AlongFile(NamedTuple):
    """A file that an instrument wrote beside the recording."""

    sample: int
    """Number of samples recorded at the time of the request."""
    instrument: str
    """Its role in the rig file."""
    name: str
    file: str
    """The file's name, in the recording's folder."""
    sha256: str


def reading_event(sample: int, instrument: str, read: Reading | NewFile, folder: Path) -> Event:
    """Make an event from an instrument's reading or file; a file is read once, for its hash.

    `folder` is the recording's. Raises DataError for content that an event cannot hold, OSError for a
    file that cannot be read.
    """
    if not (read.name + getattr(read, "unit", "")).isprintable():
        raise DataError(f"The name or unit of {read.name[:20]!r} has characters that cannot be printed.")
    about: dict[str, object] = {"instrument": instrument, "name": read.name}
    if isinstance(read, NewFile):
        kind = "file"
        if read.path.absolute().parent != folder.absolute():
            raise DataError(f"The file {read.path} must be in the recording's folder, {folder}.")
        with read.path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        about |= {"file": read.path.name, "sha256": sha256}
    else:
        kind = "reading"
        value = float(read.value)
        if not math.isfinite(value):
            raise DataError(f"The {read.name} was {value}, which is no reading.")
        about |= {"value": value, "unit": read.unit}
    text = json.dumps(about, ensure_ascii=False)
    if len(text.encode()) > _LONGEST:
        raise DataError(
            f"The names of {read.name[:20]!r} are too long for an event, which has {_LONGEST} bytes for them."
        )
    return Event(sample, kind, text)


def readings_in(events: Sequence[Event]) -> tuple[AlongReading, ...]:
    """Decode the readings among events."""
    found = [(e.sample, json.loads(e.text)) for e in events if e.kind == "reading"]
    return tuple(AlongReading(s, a["instrument"], a["name"], a["value"], a["unit"]) for s, a in found)


def files_in(events: Sequence[Event]) -> tuple[AlongFile, ...]:
    """Decode the files among events."""
    found = [(e.sample, json.loads(e.text)) for e in events if e.kind == "file"]
    return tuple(AlongFile(s, a["instrument"], a["name"], a["file"], a["sha256"]) for s, a in found)


def file_problems(events: Sequence[Event], folder: Path) -> tuple[str, ...]:
    """Check the files recorded along; return one sentence for each problem."""
    problems = []
    for written in files_in(events):
        try:
            path = beside(folder, written.file, "The recording", DataError)
        except DataError as error:
            problems.append(str(error))
            continue
        try:
            with path.open("rb") as file:
                found = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            problems.append(f"{path}, which was recorded along, cannot be read ({error.strerror or error}).")
            continue
        if found != written.sha256:
            problems.append(f"{path} was changed after it was recorded: its SHA-256 does not match.")
    return tuple(problems)


_LARGEST_DRIFT = 1e-4
"""Largest difference of two computers' rates: crystals differ by 5 to 50 ppm (docs/hardware.md, "Two cards
on one clock"). What a few noisy corrections show beyond it is noise."""

_SECONDS = 5
"""Seconds of blocks from which on they tell the rate, which is the nominal one before."""

_POINTS = 1000
"""Points whose pairs tell a slope: all pairs of ten hours' clock readings would take 40 GB."""


@dataclass(frozen=True, eq=False)
class RecordedStream:
    """A stream of another program, as it was recorded along. Nothing in it is resampled or smoothed."""

    name: str
    """Its name in the rig file."""
    sender: str
    """Its name by the sender."""
    type: str
    rate_hz: float
    """Nominal rate; 0 for a stream without one, as of markers."""
    labels: tuple[str, ...]
    """Of each channel, as far as the sender states them."""
    units: tuple[str, ...]
    values: npt.NDArray[Any]
    """(samples, channels), of the sender's own type; texts are objects."""
    stamps: FloatArray
    """(samples,) s of the sender's clock, as they came."""
    corrections: FloatArray
    """(measurements, 2): when (s of the sender's clock), and what is to be added for LSL's clock here (s)."""
    times: FloatArray
    """(samples,) s from the recording's first sample; those from before it are negative."""
    spread: float
    """How well the clocks are known (s): the larger of what 95 % of the corrections are off their line, and
    what the earliest block of a second is late. What all have in common is not in it: a network that is
    slower one way, the sender's own delay, the least delay of the DAQ's blocks."""

    def __len__(self) -> int:
        return len(self.stamps)


def read_streams(
    folder: Path, files: tuple[AlongFile, ...], blocks: npt.NDArray[np.void], rate_hz: float
) -> Mapping[str, RecordedStream]:
    """Read the streams among files recorded along. Raises DataError for one that was changed."""
    return {
        file.name: _read(folder / file.file, file, blocks, rate_hz)
        for file in files
        if file.file.endswith(".xdf")
    }


def _read(path: Path, file: AlongFile, blocks: npt.NDArray[np.void], rate_hz: float) -> RecordedStream:
    pyxdf = optional("pyxdf", "lsl", "A stream that was recorded along")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}, which was recorded along, cannot be read ({error.strerror}).") from None
    if hashlib.sha256(content).hexdigest() != file.sha256:
        raise DataError(f"{path} was changed after it was recorded: its SHA-256 does not match.")
    streams, _ = pyxdf.load_xdf(str(path), synchronize_clocks=False, dejitter_timestamps=False, verbose=False)
    streams.sort(key=lambda one: one["info"]["stream_id"])
    (clock,) = (one for one in streams if one["info"]["name"][0] == CLOCK)
    parts = [one for one in streams if one is not clock]
    here, _ = _line(clock["time_stamps"], np.ravel(clock["time_series"]) - clock["time_stamps"])
    begin, period, late = _arrivals(blocks, rate_hz)

    times, spreads = [], [late]
    for part in parts:
        stamps = np.asarray(part["time_stamps"], dtype=np.float64)
        offsets = np.asarray(part["clock_values"], dtype=np.float64)
        if not len(offsets):
            raise DataError(f"{path} has no correction of its sender's clock: too little was recorded.")
        there, spread = _line(np.asarray(part["clock_times"], dtype=np.float64), offsets)
        local = stamps + there(stamps)
        times.append((local + here(local) - begin) / period / rate_hz)
        spreads.append(spread)
    info = parts[0]["info"]
    about = _channels(info)
    return RecordedStream(
        name=file.name,
        sender=str(info["name"][0]),
        type=str(info["type"][0] or ""),
        rate_hz=float(info["nominal_srate"][0]),
        labels=tuple(label for label, _ in about),
        units=tuple(unit for _, unit in about),
        values=np.concatenate([_values(part) for part in parts]),
        stamps=np.concatenate([np.asarray(part["time_stamps"], dtype=np.float64) for part in parts]),
        corrections=np.concatenate([np.column_stack([p["clock_times"], p["clock_values"]]) for p in parts]),
        times=np.concatenate(times),
        spread=max(spreads),
    )


def _line(x: FloatArray, y: FloatArray) -> tuple[Callable[[FloatArray], FloatArray], float]:
    """A line through points of which some may be far off; and what 95 % of them are off at most."""
    slope = _slope(x, y) if len(x) > 2 else 0.0
    slope = min(max(slope, -_LARGEST_DRIFT), _LARGEST_DRIFT)
    middle = float(np.median(x))
    level = float(np.median(y - slope * (x - middle)))

    def line(t: FloatArray) -> FloatArray:
        return np.asarray(level + slope * (t - middle))

    return line, float(np.quantile(np.abs(y - line(x)), 0.95))


def _slope(x: FloatArray, y: FloatArray) -> float:
    """The median slope of all pairs of points (Theil, Sen): of every n-th where there are over `_POINTS`."""
    # A recording that is verified or listed needs no scipy.
    from scipy.stats import theilslopes  # noqa: PLC0415

    some = slice(None, None, -(-len(x) // _POINTS))
    return float(theilslopes(y[some], x[some]).slope)


def _arrivals(blocks: npt.NDArray[np.void], rate_hz: float) -> tuple[float, float, float]:
    """When the recording's first sample was taken and its samples' period, on the rig's clock (s); and how
    late the earliest block of a second is by that, in the median.

    A block arrives after its last sample, by a delay that is never less than the shortest: the line lies
    below all arrivals. Its slope is that of most pairs of these earliest blocks, because an edge of their
    convex hull, as a board's rate has it (`instruments/daq/free_running.py`), is tilted by a few seconds in
    which the computer is busy.
    """
    last = blocks["first"].astype(np.float64) + blocks["count"] - 1
    excess = blocks["time"] - last / rate_hz
    seconds = np.unique(np.floor(last / rate_hz), return_index=True)[1]
    earliest = [
        part.start + int(np.argmin(excess[part])) for part in map(slice, seconds, [*seconds[1:], None])
    ]
    x, y = last[earliest] / rate_hz, excess[earliest]
    slope = _slope(x, y) if len(x) >= _SECONDS else 0.0
    begin = float((excess - slope * last / rate_hz).min())
    return begin, (1 + slope) / rate_hz, float(np.median(y - slope * x - begin))


def _values(part: Mapping[str, Any]) -> npt.NDArray[Any]:
    """(samples, channels)."""
    series = part["time_series"]
    if isinstance(series, np.ndarray):
        return series
    return np.array(series, dtype=object).reshape(len(series), int(part["info"]["channel_count"][0]))


def _channels(info: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and unit of each channel; numbers and empty texts where the sender does not describe them."""
    try:
        found = info["desc"][0]["channels"][0]["channel"]
    except (KeyError, IndexError, TypeError):
        found = []
    said = [tuple(str((one.get(key) or [""])[0] or "") for key in ("label", "unit")) for one in found]
    count = int(info["channel_count"][0])
    said += [("", "")] * (count - len(said))
    return [(label or f"channel {number + 1}", unit) for number, (label, unit) in enumerate(said[:count])]
