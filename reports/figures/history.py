"""Figures of a rig's calibration history: its trend, its nights, and a recalibration before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...calibration import Calibration, Check
from ...calibration.recalibration import History, PlaceMetrics, calibrations_of
from ...instruments import RigFile
from .plotting import (
    BLUE,
    INK,
    ORANGE,
    SKY,
    SOFT,
    VERMILLION,
    Columns,
    colour,
    dash,
    legend_under,
    letter,
    log_scale,
    new_figure,
    style,
)

Place = tuple[str, str]

_PANELS = (
    # Figure, its axis, the factor to the axis's unit, and the threshold that bounds it.
    ("resonance_hz", "Resonance (Hz)", 1.0, "resonance"),
    ("damping", "Damping ratio (%)", 100.0, "damping"),
    ("gain", "Gain (m/s² per V)", 1.0, "gain"),
    ("coherence", "Coherence", 1.0, ""),
)


_BROKEN = (0, (1, 1))
"""Dashes of what no place has."""


@dataclass(frozen=True)
class _ActivePeriod:
    """A period (begin, end) of one active generation, with its metrics and thresholds by place."""

    name: str
    begin: datetime
    end: datetime
    metrics: Mapping[Place, PlaceMetrics]
    thresholds: Mapping[str, float]


def trend(history: History, columns: Columns = 2) -> Figure:
    """Plot resonance, damping, gain and coherence over time: every run, and the active calibration.

    The bands are the tolerances in the rig file of each calibration. Raises DataError for a history
    without any activation.
    """
    looks = history.looks
    periods = _active_periods(history, [datetime.fromisoformat(look["when"]) for look in looks])
    places = list(dict.fromkeys(place for period in periods for place in period.metrics))
    with style():
        figure = new_figure(6.2, columns)
        grid = figure.subplots(len(_PANELS), 1, sharex=True)
        for index, (axes, panel) in enumerate(zip(grid, _PANELS, strict=True)):
            for number, place in enumerate(places):
                _trace(axes, panel, place, periods, looks, number)
            for look in looks:
                if look["outcome"] == "broken":
                    when = datetime.fromisoformat(look["when"])
                    axes.axvline(when, color=VERMILLION, linewidth=0.7, linestyle=_BROKEN, zorder=0)
            axes.set_ylabel(panel[1])
            letter(axes, index, panel[1].partition(" (")[0])
            axes.ticklabel_format(axis="y", useOffset=False)
        grid[-1].set_ylim(min(grid[-1].get_ylim()[0], 0.9), 1.005)
        _legend(figure, places, 4 if columns == 2 else 2)
        locator = AutoDateLocator()  # type: ignore[no-untyped-call]
        grid[-1].xaxis.set_major_locator(locator)
        grid[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))  # type: ignore[no-untyped-call]
        grid[-1].set_xlabel(f"When (UTC; from {periods[0].begin:%Y-%m-%d})")
        return figure


def _active_periods(history: History, looks: Sequence[datetime]) -> list[_ActivePeriod]:
    activations = history.activations
    if not activations:
        raise DataError(f"{history.folder} holds no active calibration, so there is no trend to plot.")
    begins = [datetime.fromisoformat(activation.when) for activation in activations]
    last = max([*begins, *looks])
    found: dict[str, tuple[Mapping[Place, PlaceMetrics], Mapping[str, float]]] = {}
    for name in {activation.generation for activation in activations}:
        calibrations = calibrations_of(history.find(name))
        file = RigFile.model_validate_json(calibrations[0].response.rig_file)
        metrics = {(c.response.patch, c.response.point): PlaceMetrics.of(c) for c in calibrations}
        found[name] = (metrics, file.recalibration.model_dump())
    return [
        _ActivePeriod(activation.generation, begin, end, *found[activation.generation])
        for activation, begin, end in zip(activations, begins, [*begins[1:], last], strict=True)
    ]


def _trace(
    axes: Any,
    panel: tuple[str, str, float, str],
    place: Place,
    periods: Sequence[_ActivePeriod],
    looks: Sequence[Mapping[str, Any]],
    number: int,
) -> None:
    name, _, factor, bound = panel
    paint = colour(number)
    for period in periods:
        if place not in period.metrics:
            continue
        level = factor * getattr(period.metrics[place], name)
        span = (period.begin, period.end)
        axes.plot(
            span, (level, level), color=paint, linewidth=1.1, linestyle=dash(number), solid_capstyle="butt"
        )
        if bound:
            width = period.thresholds[bound] * level
            axes.fill_between(span, level - width, level + width, color=paint, alpha=0.12, linewidth=0)
        axes.plot([period.begin], [level], "s", markersize=4, color=paint)
    for kind, marker, size in (("unchanged", "o", 2.6), ("drifted", "^", 4.2), ("broken", "x", 3.6)):
        seen = [
            (datetime.fromisoformat(look["when"]), factor * found["now"][name])
            for look in looks
            for found in look["places"]
            if (found["patch"], found["point"]) == place and found["kind"] == kind and found["now"]
        ]
        if seen:
            axes.plot(*zip(*seen, strict=True), marker, markersize=size, color=paint, markeredgewidth=0.8)


def _legend(figure: Figure, places: Sequence[Place], across: int) -> None:
    """Add the legend: meaning of the marks, and colour of each place when there are several."""
    marks = [
        Line2D([], [], color=INK, marker="s", markersize=4, label="active calibration"),
        Line2D([], [], color=INK, marker="o", markersize=2.6, linestyle="", label="look: unchanged"),
        Line2D([], [], color=INK, marker="^", markersize=4.2, linestyle="", label="drifted"),
        Line2D([], [], color=VERMILLION, linewidth=0.7, linestyle=_BROKEN, label="broken"),
    ]
    if len(places) > 1:
        marks += [
            Line2D([], [], color=colour(number), linestyle=dash(number), label=f"patch {patch} at {point}")
            for number, (patch, point) in enumerate(places)
        ]
    figure.legend(handles=marks, loc="outside upper left", ncols=across)


def before_and_after(before: Mapping[str, Check], after: Mapping[str, Check]) -> Figure:
    """Draw each button's target and the measured acceleration with its old and its new drive."""
    names = sorted({*before, *after})
    with style():
        figure = new_figure(1.6 * len(names) + 0.4)
        grid = figure.subplots(len(names), 2, squeeze=False)
        for row, name in enumerate(names):
            for column, (when, checks) in enumerate((("before", before), ("after", after))):
                axes = grid[row, column]
                title = f"{name}, {when}: not played"
                if name in checks:
                    check = checks[name]
                    _stretch(axes, check)
                    title = f"{name}, {when}: error {check.whole.brief}, {check.verdict}"
                letter(axes, 2 * row + column, title)
                axes.set_xlabel("Time in the drive (ms)" if row == len(names) - 1 else "")
            grid[row, 0].set_ylabel("Acceleration (m/s²)")
        figure.legend(handles=grid[0, 0].get_lines()[:2], loc="outside upper left", ncols=2)
        return figure


def _stretch(axes: Axes, check: Check) -> None:
    """Draw 20 ms to either side of the target's largest acceleration."""
    time = 1e3 * np.arange(len(check.target)) / check.rate_hz
    middle = time[int(np.argmax(np.abs(check.target)))]
    part = np.abs(time - middle) <= 20
    axes.plot(time[part], check.target[part], color=ORANGE, linewidth=2.0, label="Target")
    axes.plot(time[part], check.measured[part], color=INK, linewidth=0.8, label="Measured")
    axes.set_xlim(time[part][0], time[part][-1])


def responses(old: Sequence[Calibration], new: Sequence[Calibration]) -> Figure:
    """Draw the modelled response of each place before and after the recalibration."""
    with style():
        figure = new_figure(1.9 * len(new) + 0.3)
        grid = figure.subplots(len(new), 2, squeeze=False, gridspec_kw={"width_ratios": (2.1, 1)})
        for row, now in enumerate(new):
            place = (now.response.patch, now.response.point)
            was = [c for c in old if (c.response.patch, c.response.point) == place]
            peak = now.model.resonance_hz
            band: FloatArray = np.arange(*now.model.band, 0.25)
            near = band[np.abs(band - peak) < 15]
            for axes, f in zip(grid[row], (band, near), strict=True):
                for c in was:
                    axes.plot(f, 1e6 * np.abs(c.model.velocity(f)), color=SKY, linewidth=1.8, label="Before")
                axes.plot(f, 1e6 * np.abs(now.model.velocity(f)), color=BLUE, linewidth=0.9, label="Now")
                axes.set_xlim(f[0], f[-1])
            log_scale(grid[row, 0])
            grid[row, 0].set_ylabel("Velocity (µm/s per V)")
            room = 1 if row == 0 else 0
            letter(grid[row, 0], 2 * row, f"Patch {place[0]} at the {place[1]} point", room)
            letter(grid[row, 1], 2 * row + 1, f"Around {peak:.1f} Hz", room)
        legend_under(grid[0, 0], 2)
        for axes in grid[-1]:
            axes.set_xlabel("Frequency (Hz)")
        return figure


# Figure of the nights of a history: how far each mode has drifted, as small multiples.

_ACROSS = {1: 2, 2: 5}
"""Panels of a row."""
_SAME = 0.01
"""Relative difference of frequencies within which a mode is one that was known before a renewal."""


@dataclass
class _Mode:
    """A mode of a place, through all calibrations of it."""

    place: tuple[str, str]
    first_hz: float
    when: list[datetime] = field(default_factory=list)
    hz: list[float] = field(default_factory=list)
    """Found at each of these times."""

    @property
    def drift(self) -> list[float]:
        """In %, since its first night's calibration."""
        return [100 * (hz / self.first_hz - 1) for hz in self.hz]


def nights_figure(looks: Sequence[Mapping[str, Any]], columns: Columns = 2) -> Figure:
    """Draw the drift of each mode over the nights of a history: one small panel a mode, all on one scale.

    `looks` are the history's entries. Raises DataError when none of them measured a mode.
    """
    modes = _modes(looks)
    if not modes:
        raise DataError("No night has measured a mode yet, so there is no drift to draw.")
    across = min(_ACROSS[columns], len(modes))
    rows = -(-len(modes) // across)
    with style():
        figure = new_figure(1.05 * rows + 0.75, columns)
        grid = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
        several = len({mode.place for mode in modes}) > 1
        for axes, mode in zip(grid.flat, modes, strict=False):
            _dates(axes, looks)
            axes.axhline(0, color=SOFT, linewidth=0.5)
            axes.plot(mode.when, mode.drift, "-o", color=BLUE, markersize=2.4, linewidth=0.9, label="drift")
            place = f"{mode.place[0]} {mode.place[1]}, " if several else ""
            axes.set_title(f"{place}{mode.first_hz:.0f} Hz", fontsize=7.5, parse_math=False)
        for axes in grid.flat[len(modes) :]:
            axes.set_visible(False)
        largest = max(0.1, *(abs(value) for mode in modes for value in mode.drift))
        grid[0, 0].set_ylim(-1.2 * largest, 1.2 * largest)
        _label(figure, grid, len(modes), looks)
        return figure


def _dates(axes: Any, looks: Sequence[Mapping[str, Any]]) -> None:
    """Lines at the nights that were broken, and at those that renewed the calibration."""
    for look in looks:
        if look["outcome"] in _LINES:
            paint, dashes = _LINES[look["outcome"]]
            axes.axvline(_time(look), color=paint, linewidth=0.7, linestyle=dashes, zorder=0)


_LINES = {"broken": (VERMILLION, (0, (1, 1))), "restored": (INK, (0, (4, 2)))}


def _label(figure: Figure, grid: Any, count: int, looks: Sequence[Mapping[str, Any]]) -> None:
    """Label the lowest panel of each column with the first and the last night, and write the legend."""
    rows, across = grid.shape
    ends = sorted({_time(looks[0]), _time(looks[-1])})
    form = "%H:%M" if ends[0].date() == ends[-1].date() else "%d %b"
    for number, axes in enumerate(grid.flat[:count]):
        if number + across >= count:
            axes.set_xticks(ends, [f"{end:{form}}" for end in ends])
            axes.tick_params(axis="x", labelbottom=True)
    for row in range(rows):
        grid[row, 0].set_ylabel("Drift (%)")
    handles = [Line2D([], [], color=BLUE, marker="o", markersize=2.4, label="drift since the first night")]
    handles += [
        Line2D([], [], color=paint, linestyle=dashes, linewidth=0.7, label=label)
        for (paint, dashes), label in zip(_LINES.values(), ("broken", "calibration renewed"), strict=True)
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=3)


def _modes(looks: Sequence[Mapping[str, Any]]) -> list[_Mode]:
    """The modes of all places, by place and frequency; each is followed through renewals."""
    found: list[_Mode] = []
    known: dict[tuple[str, str, str, float], _Mode] = {}
    for look in looks:
        for place in look["places"]:
            where = (place["patch"], place["point"])
            for one in place.get("modes", []):
                key = (look["compared_with"], *where, one["hz"])
                if key not in known:
                    known[key] = _known(found, where, one["hz"])
                known[key].when.append(_time(look))
                known[key].hz.append(one["hz"] * (1 + one["shift"]))
    return sorted(found, key=lambda mode: (mode.place, mode.first_hz))


def _known(found: list[_Mode], where: tuple[str, str], hz: float) -> _Mode:
    """The mode of a calibrated frequency: one whose last frequency is near, or a new one."""
    here = [mode for mode in found if mode.place == where]
    apart = [abs(mode.hz[-1] / hz - 1) for mode in here]
    if apart and min(apart) < _SAME:
        return here[int(np.argmin(apart))]
    found.append(_Mode(where, hz))
    return found[-1]


def _time(look: Mapping[str, Any]) -> datetime:
    return datetime.fromisoformat(look["when"])
