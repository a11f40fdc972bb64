"""A verdict at a glance: one small figure, three gauges and one sentence for each button.

The first screen of a report shows nothing else. How much: the share of the press's energy that is played.
How like: the error up to the laser's corner, with its interval, beside the tolerance. How loud: the level
beside the threshold of a finger that presses, with the range in which that threshold may lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...acquisition import Representative
from ...base.arrays import FloatArray
from ...base.wording import capital
from ...calibration import Check, Feeling
from ...calibration.drive import activation_time
from .parts import Cell, verdict_cell
from .words import percent

_WINDOW = 0.040
"""s shown around the largest peak of the target: ten periods of a carrier of 250 Hz, which can be told apart
on a phone."""
_POINTS = 400
"""Points of a curve: two for each pixel of a narrow screen."""


_ELSEWHERE = "the reason, which is not the error, stands with the verdict"

WIDTH, HEIGHT = 360, 100
"""Units of the drawing of a motion, which is stretched to its place."""


@dataclass(frozen=True, eq=False)
class Gauge:
    """A number on a scale from `low` to `high`, with the interval that it lies in."""

    label: str
    said: str
    value: float
    """NaN where it is not known: then nothing is marked."""
    low: float
    high: float
    interval: tuple[float, float] | None = None
    """Of the value."""
    limit: float | None = None
    """What the value is judged against."""
    limit_range: tuple[float, float] | None = None
    """Where the limit may lie."""

    @property
    def known(self) -> bool:
        """False for a value that is not known."""
        return bool(np.isfinite(self.value))

    def place(self, value: float) -> float:
        """Place of a value on the scale, 0 to 100; beyond an end it is the end."""
        return float(np.clip(100 * (value - self.low) / (self.high - self.low), 0, 100))

    def marks(self) -> list[tuple[str, float, float, float, float]]:
        """What is drawn, one over the other, on a field of 100 by 10: its name, x, y, width and height."""
        found = [("scale", 0.0, 100.0, 2.0)]
        for name, ends, height in (("range", self.limit_range, 8.0), ("interval", self.interval, 4.0)):
            if ends is not None:
                found.append((name, self.place(ends[0]), self.place(ends[1]), height))
        if self.limit is not None:
            found.append(("limit", self.place(self.limit) - 0.4, self.place(self.limit) + 0.4, 10.0))
        if self.known:
            found.append(("value", self.place(self.value) - 1, self.place(self.value) + 1, 8.0))
        return [
            (name, round(low, 1), (10 - height) / 2, round(high - low, 1), height)
            for name, low, high, height in found
        ]


@dataclass(frozen=True, eq=False)
class Motion:
    """Curves (points,) over `time` (s after the activation where that is known), in the target's peak."""

    time: FloatArray
    target: FloatArray
    measured: FloatArray
    recorded: FloatArray | None
    """The recorded press on the same clock, in its own peak; None where it is not at hand."""
    band: float
    """Half the height of the band around the target: the tolerance times the target's rms."""
    activation: float | None
    """s; None where it is not known or not within the window."""

    @property
    def ends(self) -> tuple[str, str]:
        """What stands below the left and the right edge of a drawing."""
        first, last = (f"{1e3 * self.time[k]:+.0f} ms".replace("-", "−") for k in (0, -1))
        return first, last

    @property
    def top(self) -> float:
        """The value at the upper edge of a drawing."""
        curves = (self.target + self.band, self.target - self.band, self.measured)
        return 1.05 * max(1.0, *(float(np.abs(one).max()) for one in curves))

    def strokes(self) -> list[tuple[str, str]]:
        """What is drawn, one over the other: its name, and its path in SVG on `WIDTH` by `HEIGHT`."""
        low, high = float(self.time[0]), float(self.time[-1])
        across = WIDTH * (self.time - low) / (high - low)

        def line(values: FloatArray, order: int = 1) -> str:
            down = HEIGHT * (0.5 - 0.5 * np.clip(values / self.top, -1, 1))
            return "L".join(f"{x:.1f} {y:.1f}" for x, y in list(zip(across, down, strict=True))[::order])

        band = f"M{line(self.target + self.band)}L{line(self.target - self.band, -1)}Z"
        found = [("band", band)]
        if self.recorded is not None:
            found.append(("recorded", f"M{line(self.recorded)}"))
        found.append(("measured", f"M{line(self.measured)}"))
        if self.activation is not None:
            x = WIDTH * (self.activation - low) / (high - low)
            found.append(("activation", f"M{x:.1f} 0V{HEIGHT}"))
        return found


@dataclass(frozen=True, eq=False)
class Glance:
    """What the first screen shows of one button."""

    title: str
    verdict: Cell
    motion: Motion
    gauges: tuple[Gauge, Gauge, Gauge]
    sentence: str
    """At most twenty words."""


def key_of(glances: Sequence[Glance]) -> list[tuple[str, str]]:
    """What is drawn in any of the glances: the name of a stroke, and what it is."""
    drawn = {name for one in glances for name, _ in one.motion.strokes()}
    limit = "activation, or limit" if "activation" in drawn else "limit"
    every = [
        ("recorded", "recorded press"),
        ("measured", "measured motion"),
        ("band", "tolerated, or where the threshold may lie"),
    ]
    return [*(one for one in every if one[0] in drawn), ("activation", limit)]


def check_glance(check: Check, feeling: Feeling, press: Representative | None) -> Glance:
    """What a check says at a glance; the recorded `press` adds its curve and its activation."""
    drive, (low, high) = check.drive, check.interval
    sensation = feeling.pressing
    near = max(2 * check.tolerance, 1e-6)
    like = Gauge(
        "how like",
        f"error {check.whole.said}",
        check.error or np.nan,  # zero was not measured
        0.0,
        near,
        (low, high) if np.isfinite(low) and np.isfinite(high) else None,
        check.tolerance,
    )
    much = Gauge("how much", f"{percent(drive.in_band, 0)} of the energy", drive.in_band, 0.0, 1.0)
    level = sensation.level
    loud = Gauge(
        "how loud",
        f"{abs(level):.0f} dB {'below' if level < 0 else 'above'} threshold"
        if np.isfinite(level)
        else "not known",
        level,
        -30.0,
        30.0,
        limit=0.0,
        limit_range=(-sensation.act.lower, sensation.act.higher),
    )
    title = f"{capital(drive.button)}{f' at {drive.point}' if drive.point != 'button' else ''}"
    return Glance(
        title,
        verdict_cell(check.verdict),
        _motion(check, press),
        (much, like, loud),
        _sentence(check, feeling),
    )


def _sentence(check: Check, feeling: Feeling) -> str:
    most = percent(check.tolerance, 0)
    match check.verdict:
        case "pass":
            felt = {
                "yes": "most people who press feel it",
                "no": "most people who press do not feel it",
                "not known": "whether a pressing finger feels it is not known",
            }[feeling.felt]
            return f"Repeats the press at {percent(check.drive.scale)} of its size; {felt}."
        case "fail":
            if check.interval[0] > check.tolerance:
                return f"Does not repeat the press: the motion is off by more than {most}."
            return f"Does not pass: {_ELSEWHERE}."
        case _ if check.interval[1] <= check.tolerance:
            return f"These plays do not show that it passes: {_ELSEWHERE}."
        case _:
            return f"These plays cannot tell whether the motion is within {most} of the press."


def _motion(check: Check, press: Representative | None) -> Motion:
    """The curves around the largest peak of the target."""
    target = check.target
    peak = float(np.max(np.abs(target))) or 1.0
    middle = int(np.argmax(np.abs(target))) / check.rate_hz
    time = np.linspace(middle - _WINDOW / 2, middle + _WINDOW / 2, _POINTS)
    clock = np.arange(len(target)) / check.rate_hz
    zero, recorded = 0.0, None
    if press is not None:
        zero = activation_time(press, check.drive)
        own = (np.arange(len(press.acceleration)) - press.activation_index) / press.rate_hz + zero
        largest = float(np.max(np.abs(press.acceleration))) or 1.0
        recorded = np.interp(time, own, press.acceleration / largest, 0.0, 0.0)
    return Motion(
        time - zero,
        np.interp(time, clock, target, 0.0, 0.0) / peak,
        np.interp(time, clock, check.measured, 0.0, 0.0) / peak,
        recorded,
        check.tolerance * float(np.sqrt(np.mean(_loud(target) ** 2))) / peak,
        0.0 if press is not None and time[0] <= zero <= time[-1] else None,
    )


def _loud(target: FloatArray) -> FloatArray:
    """The part of a target that moves: silence around it would make its rms small."""
    moving = np.flatnonzero(np.abs(target) > 0.05 * np.max(np.abs(target), initial=0.0))
    return target[moving[0] : moving[-1] + 1] if len(moving) else target
