"""What is exported: four plain views of a file, which every format writes in its own way."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..acquisition.presses import Cell
from ..base.arrays import FloatArray, IntArray
from ..base.errors import DataError
from ..base.files import new_file
from ..calibration import Response
from ..terminal.progress import SIMULATED

About = Mapping[str, str | float | int | bool]
"""Where data come from: source, content hash, simulated or not, and what else is known."""


@dataclass(frozen=True, eq=False)
class Channel:
    """One signal: (samples,) in `unit`; sample k was taken `delay` (s) after k / rate."""

    name: str
    unit: str
    values: FloatArray
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class Signals:
    """Channels on one sample clock; `main` names the one that a player with one output plays."""

    title: str
    rate_hz: float
    channels: tuple[Channel, ...]
    main: str
    about: About

    def __getitem__(self, name: str) -> Channel:
        """The channel of a name. Raises KeyError."""
        return {channel.name: channel for channel in self.channels}[name]

    @property
    def time(self) -> FloatArray:
        """(samples,) s from the first sample."""
        return np.asarray(np.arange(len(self.channels[0].values)) / self.rate_hz)


@dataclass(frozen=True, eq=False)
class Responses:
    """Frequency responses on the same frequencies: m/s per V at the patch, one a patch and point.

    `grid` is (responses, 2), the row and column of each point on the table from 0, or None for one point.
    """

    title: str
    responses: tuple[Response, ...]
    about: About
    grid: IntArray | None = None


@dataclass(frozen=True, eq=False)
class PressTable:
    """One row a press and attempt, or a row of a curve.

    `units` names the columns, each with its unit ("" without one).
    """

    title: str
    units: Mapping[str, str]
    rows: tuple[Mapping[str, Cell], ...]
    about: About


@dataclass(frozen=True, eq=False)
class Envelope:
    """A short vibration as breakpoints: (points,) s from the start, amplitude 0 to 1, frequency (Hz).

    An amplitude of 1 stands for `peak` m/s^2. Between breakpoints both are straight lines.
    """

    title: str
    times: FloatArray
    amplitude: FloatArray
    frequency_hz: FloatArray
    peak: float
    about: About

    def mapping(self, frequency: str) -> str:
        """Sentence on what the file's numbers stand for; `frequency` says it of the frequency."""
        said = f"Amplitude 1 is {self.peak:.4g} m/s^2 (peak of the envelope), linear. {frequency}"
        return f"{said} {SIMULATED}" if self.about["simulated"] else said


def even_rate(path: Path, time: FloatArray) -> float:
    """Samples per second of a file's column of time (s). Raises DataError when its steps are not equal."""
    steps = np.diff(time)
    if not len(steps) or not steps.min() > 0 or not np.ptp(steps) <= 0.01 * steps.mean():
        raise DataError(f"{path} is not sampled at a constant rate: resample it first.")
    # A time with few digits gives a rate that is off in the last of them.
    return float(f"{1 / steps.mean():.6g}")


def sidecar(path: Path) -> Path:
    """Name of the file beside `path` with units, scale and origin, for formats without room for them."""
    return path.with_name(path.name + ".json")


def write_sidecar(path: Path, signals: Signals, **more: object) -> None:
    """Write the sidecar of a file of signals; `more` are entries of the format's own."""
    channels = [{"name": c.name, "unit": c.unit, "delay_s": c.delay} for c in signals.channels]
    own = {"title": signals.title, "rate_hz": signals.rate_hz, "channels": channels}
    write_json(sidecar(path), {**own, **more, "about": dict(signals.about)})


def read_sidecar(path: Path) -> dict[str, Any]:
    """Entries of the sidecar of a file; empty without one. Raises DataError for a damaged one."""
    beside = sidecar(path)
    if not beside.is_file():
        return {}
    try:
        found = json.loads(beside.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or not isinstance(found.get("about", {}), dict):
        raise DataError(f"{beside} is no JSON object: move it away, or export {path.name} again.")
    return found


def write_json(path: Path, value: object) -> None:
    """Write a new JSON file. Raises DataError when it exists or cannot be written."""
    with new_file(path) as part:
        part.write_text(json.dumps(value, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
