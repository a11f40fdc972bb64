"""Thresholds of vibrotactile detection: a table of data with the source of every row (`thresholds.toml`).

A lab may measure one with its own people, in place of the table's estimate (`LabThreshold`). Model: in a
staircase on one digital button the amplitude of its drive was varied; the motion at a person's threshold is
that of the check, times the amplitude. Its level above the table's curve for a finger that presses is that
person's threshold; the mean over people shifts the curve, and their standard deviation is the spread. What
breaks it: a button of another spectrum than the one that was played, as far as the form of the curve is an
estimate; another force; people unlike those who took part.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError

if TYPE_CHECKING:
    from ...instruments import Rig


REFERENCE = 1e-6
"""Reference of vibration levels (m/s^2 rms; ISO 1683)."""
_MARKS = ("found", "estimate")


@dataclass(frozen=True, eq=False)
class Curve:
    """Detection threshold over frequency, for one kind of contact."""

    name: str
    contact: str
    """Kind of contact and of signal, in words."""
    frequencies: FloatArray
    """(rows,) Hz, ascending."""
    levels: FloatArray
    """(rows,) dB re 1e-6 m/s^2 rms."""
    marks: tuple[str, ...]
    """"found" or "estimate" for each row."""

    def level(self, frequencies: FloatArray) -> FloatArray:
        """Threshold (dB re 1e-6 m/s^2 rms) at `frequencies` (Hz); infinite outside the table.

        Between rows the level is a straight line over the logarithm of frequency.
        """
        with np.errstate(divide="ignore"):
            place = np.log(frequencies)
        inside = np.interp(place, np.log(self.frequencies), self.levels, left=np.inf, right=np.inf)
        return np.asarray(inside)

    @property
    def found_to_hz(self) -> float:
        """Highest frequency (Hz) of a row that was found; above it the table is an estimate."""
        return float(max(f for f, mark in zip(self.frequencies, self.marks, strict=True) if mark == "found"))


@dataclass(frozen=True)
class Difference:
    """A just noticeable difference of amplitude, and where it was measured."""

    fraction: float
    sensation: float
    """Level above threshold (dB)."""
    mark: str
    source: str


@dataclass(frozen=True, eq=False)
class Act:
    """What a finger does with a vibrating surface, and the threshold of the mean person who does it."""

    name: str
    """"pressing", "resting" or "sliding"."""
    does: str
    """The act as a verb, after "a person who"."""
    curve: Curve
    higher: float
    """How far the mean person's threshold may lie above the curve (dB)."""
    lower: float
    """How far it may lie below (dB), for one short event."""
    spread: float
    """Standard deviation between people (dB)."""
    basis: str
    """What the curve rests on, as a clause."""
    mark: str
    """"found" or "estimate" of the table; "measured" by a lab."""
    shift: float = 0.0
    """Added to the curve (dB)."""

    def level(self, frequencies: FloatArray) -> FloatArray:
        """Threshold of the mean person (dB re 1e-6 m/s^2 rms) at `frequencies` (Hz)."""
        return np.asarray(self.curve.level(frequencies) + self.shift)


@dataclass(frozen=True, eq=False)
class Thresholds:
    """The table: an act of the finger and its threshold, and just noticeable differences."""

    acts: tuple[Act, ...]
    burst: float
    """Length (s) of the bursts of which the curves are the thresholds: the window of a level."""
    differences: tuple[Difference, ...]

    def act(self, name: str) -> Act:
        """The act of that name."""
        return next(one for one in self.acts if one.name == name)


@cache
def thresholds() -> Thresholds:
    """Read the table that comes with the package."""
    return parse_thresholds(
        resources.files(__package__).joinpath("thresholds.toml").read_text(encoding="utf-8")
    )


def parse_thresholds(text: str) -> Thresholds:
    """Read a table (TOML). Raises DataError for a row without a mark or a known source."""
    table = tomllib.loads(text)
    sources = table.get("sources", {})
    curves = {}
    for curve in table["curve"]:
        rows = sorted(curve["rows"], key=lambda row: float(row["hz"]))
        for row in rows:
            _require_origin(row, f"of the curve {curve['name']!r} at {row['hz']:g} Hz", sources)
        curves[curve["name"]] = Curve(
            curve["name"],
            curve["contact"],
            np.array([row["hz"] for row in rows], dtype=np.float64),
            np.array([row["level"] for row in rows], dtype=np.float64),
            tuple(row["mark"] for row in rows),
        )
    for part in ("act", "force", "difference", "summation"):
        for row in table[part]:
            _require_origin(row, f"under {part!r}", sources)
    for part in ("burst", "event", "spread"):
        _require_origin(table[part], f"under {part!r}", sources)
    return Thresholds(
        acts=tuple(
            Act(
                name=row["name"],
                does=row["does"],
                curve=curves[row["curve"]],
                higher=float(row["higher"]),
                lower=float(row["lower"]) + float(table["event"]["lower"]),
                spread=float(table["spread"]["level"]),
                basis=row["basis"],
                mark=row["mark"],
            )
            for row in table["act"]
        ),
        burst=float(table["burst"]["seconds"]),
        differences=tuple(
            Difference(row["fraction"], row["sensation"], row["mark"], row["source"])
            for row in table["difference"]
        ),
    )


def _require_origin(row: dict[str, Any], where: str, sources: dict[str, str]) -> None:
    if row.get("mark") not in _MARKS:
        raise DataError(f"The row {where} has no mark: it must be one of {', '.join(_MARKS)}.")
    if not sources.get(row.get("source", ""), "").strip():
        raise DataError(f"The row {where} names no source that is listed: give the source of every figure.")


@dataclass(frozen=True)
class LabThreshold:
    """The threshold of a lab's people; see the module."""

    people: int
    shift: float
    """Threshold of the mean person over the table's curve for a finger that presses (dB)."""
    uncertainty: float
    """Half of its interval of 95 % (dB)."""
    spread: float
    """Standard deviation between people (dB), the scatter of the experiment included."""
    button: str
    """Button that was played."""
    force: float
    """Force at its activation (N); NaN if not measured."""
    simulated: bool
    """True when simulated participants answered."""


def pressing_act(lab: LabThreshold | None) -> Act:
    """The act of a finger that presses, by the lab's threshold or else by the table."""
    act = thresholds().act("pressing")
    if lab is None:
        return act
    force = f" at {lab.force:.1f} N" if lab.force > 0 else ""
    who = "simulated participants" if lab.simulated else "people"
    return replace(
        act,
        shift=lab.shift,
        higher=lab.uncertainty,
        lower=lab.uncertainty,
        spread=lab.spread,
        mark="measured",
        basis=f"that of {lab.people} {who} of this lab, measured with its {lab.button} button{force}",
    )


def lab_threshold(rig: Rig) -> LabThreshold | None:
    """The threshold in a rig's file, in its table `[people]`; None without one.

    Raises ConfigurationError for simulated people on a real rig.
    """
    people = rig.file.people
    if people is None:
        return None
    if people.simulated and not rig.simulated:
        raise ConfigurationError(
            f"The [people] of the rig file of {rig.name!r} are simulated participants, and the rig is real: "
            "take the table out, or measure a threshold with people."
        )
    return LabThreshold(
        people=people.number,
        shift=people.threshold,
        uncertainty=people.uncertainty,
        spread=people.spread,
        button=people.button,
        force=math.nan if people.force is None else people.force,
        simulated=people.simulated,
    )
