"""Figures of a check, of a digital button and its plan: motion, iterations, errors, what a finger feels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, MultipleLocator, NullFormatter

from ...base.wording import capital
from ...calibration import ButtonPlan, Check, DigitalButton, Feeling, check_feeling
from ...calibration.drive import TOLERANCE
from ...calibration.perception import shares
from .plotting import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    VERMILLION,
    Columns,
    active,
    colour,
    dash,
    legend_under,
    letter,
    new_figure,
    panels,
    style,
)


def check_figure(check: Check, columns: Columns = 2) -> Figure:
    """Draw target and measured acceleration, third octaves with the plays' noise, and what is felt of it."""
    with style():
        drawn, panels = _panels(columns, ("motion", "motion", "motion", "octaves"), _FELT)
        _check(panels, check)
        draw_feeling(panels["bands"], panels["time"], check_feeling(check))
    return drawn


def button_figure(button: DigitalButton, columns: Columns = 2) -> Figure:
    """Draw a button's check, what is felt of it, and each iteration's error over the plays' noise."""
    with style():
        drawn, panels = _panels(columns, _MADE, _FELT)
        _check(panels, button.check)
        _learning(panels["learning"], button)
        draw_feeling(panels["bands"], panels["time"], check_feeling(button.check, button.press))
    return drawn


def iterations_figure(button: DigitalButton, columns: Columns = 2) -> Figure:
    """Draw a button's check and each iteration's error, for a report that shows what is felt elsewhere."""
    with style():
        drawn, panels = _panels(columns, _MADE)
        _check(panels, button.check)
        _learning(panels["learning"], button)
    return drawn


_MADE = ("motion", "motion", "octaves", "learning")
_FELT = ("bands", "bands", "time", "time")
_TITLES = {
    "motion": "Motion", "octaves": "Third octaves", "learning": "Corrections", "bands": "Loudest second",
    "time": "Over the threshold",
}  # fmt: skip
_ROWS = {"motion": 1, "octaves": 3, "learning": 3, "bands": 3, "time": 2}
"""Rows of the legend of each panel."""


def _panels(columns: Columns, *rows: Sequence[str]) -> tuple[Figure, dict[str, Axes]]:
    if columns == 2:
        drawn = new_figure(2.6 * len(rows))
        panels = drawn.subplot_mosaic([list(row) for row in rows])
    else:
        names = list(dict.fromkeys(name for row in rows for name in row))
        drawn = new_figure(2.0 * len(names), columns)
        panels = drawn.subplot_mosaic([[name] for name in names])
    for index, (name, axes) in enumerate(panels.items()):
        beside = next(row for row in rows if name in row) if columns == 2 else (name,)
        letter(axes, index, _TITLES[name], max(_ROWS[one] for one in beside))
    return drawn, panels


def _check(panels: dict[str, Axes], check: Check) -> None:
    _motion(panels["motion"], check)
    _octaves(panels["octaves"], check)


def _motion(axes: Axes, check: Check) -> None:
    begin, end = active(check.target, check.rate_hz)
    part = slice(max(0, round(begin * check.rate_hz)), round(end * check.rate_hz))
    milliseconds = 1e3 * np.arange(len(check.target))[part] / check.rate_hz
    axes.plot(milliseconds, check.target[part], color=ORANGE, linewidth=1.8, label="target")
    axes.plot(milliseconds, check.measured[part], color=INK, linewidth=0.6, label="measured")
    axes.set_xlabel("Time (ms)")
    axes.set_ylabel("Acceleration (m/s²)")
    legend_under(axes, 2)


def _octaves(axes: Axes, check: Check) -> None:
    axes.semilogx(
        check.octaves.hz, check.octaves.target_db, "o-", color=ORANGE, markersize=3.5, label="target"
    )
    axes.semilogx(
        check.octaves.hz, check.octaves.measured_db, "s--", color=INK, markersize=2, label="measured"
    )
    axes.semilogx(check.octaves.hz, check.octaves.floor_db, ":", color=GREY, label="noise of the mean")
    # Outside the band the target is zero.
    axes.set_ylim(bottom=min(check.octaves.floor_db.min(), check.octaves.measured_db.min()) - 5)
    axes.xaxis.set_major_locator(LogLocator(numticks=5))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("Third octave (Hz)")
    axes.set_ylabel("Level (dB re 1 m/s²)")
    legend_under(axes, 1)


def _learning(axes: Axes, button: DigitalButton) -> None:
    tried = button.learning.iterations
    numbers = np.arange(len(tried))
    values = np.array([100 * i.within.root for i in tried])
    kept = np.array([i.kept for i in tried])
    axes.plot(numbers[kept], values[kept], "o-", color=BLUE, markersize=4, label="kept")
    if not kept.all():
        axes.plot(numbers[~kept], values[~kept], "x", color=INK, markersize=4, label="not kept")
    axes.plot(numbers, [100 * i.within.floor for i in tried], ":", color=GREY, label="noise of the mean")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("Iteration")
    axes.set_ylabel("Error in band (%)")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.set_xlim(-0.5, len(tried) - 0.5)
    legend_under(axes, 1)


# Figure of what a finger would feel: third octaves against thresholds, and the level over time.

_SHOWN_DB = 60.0
"""Range of levels that is drawn (dB)."""
_TICKS = (50, 100, 200, 500, 1000)


def feeling_figure(results: Sequence[tuple[str, Feeling]], columns: Columns = 2) -> Figure:
    """Draw, for each (button, feeling), levels against thresholds by third octave, and over time.

    Left: target, measured motion, residual and recorded press, the noise of the plays, and the thresholds of
    a finger that presses and of one at rest. Right: the level of 20 ms above the threshold of a finger that
    presses.
    """
    with style():
        figure, grid = panels(len(results), 2, 1.95, columns, ratios=(1.15, 1))
        for row, ((button, feeling), (bands, time)) in enumerate(zip(results, grid, strict=True)):
            room = 3 if row == 0 else 0
            letter(bands, 2 * row, f"{capital(button)}, felt by a pressing finger: {feeling.felt}", room)
            people = f"{feeling.measured.pressing:+.0f} dB, {shares(*feeling.pressing.people)} of people"
            letter(time, 2 * row + 1, people.replace("-", "−"), room)
            draw_feeling(bands, time, feeling, with_legend=row == 0)
        return figure


def draw_feeling(bands: Axes, time: Axes, feeling: Feeling, with_legend: bool = True) -> None:
    """Draw the levels in third octaves into `bands`, and those over time into `time`."""
    _bands(bands, feeling)
    _time(time, feeling)
    bands.set_xlabel("Third octave (Hz)")
    time.set_xlabel("Time (ms)")
    if with_legend:
        legend_under(bands, 3)
        legend_under(time, 2)


def _bands(axes: Axes, feeling: Feeling) -> None:
    hz, act = feeling.octaves_hz, feeling.pressing.act
    shown = hz > 0.98 * _TICKS[0]
    axes.fill_between(
        hz[shown],
        feeling.pressing_db[shown] - act.lower,
        feeling.pressing_db[shown] + act.higher,
        color=GREY,
        alpha=0.25,
        linewidth=0,
    )
    axes.plot(hz[shown], feeling.pressing_db[shown], color=INK, linewidth=1.2, label="threshold, pressing")
    axes.plot(hz[shown], feeling.resting_db[shown], color=INK, linestyle=":", label="threshold, at rest")
    if feeling.recorded is not None:
        axes.plot(
            hz[shown],
            feeling.recorded.bands[shown],
            "-",
            color=GREY,
            linewidth=1.8,
            label="recorded press",
        )
    axes.plot(
        hz[shown],
        feeling.target.bands[shown],
        "o-",
        color=BLUE,
        markersize=4.5,
        markerfacecolor="none",
        label="target",
    )
    axes.plot(
        hz[shown], feeling.measured.bands[shown], "s--", color=VERMILLION, markersize=2.5, label="measured"
    )
    axes.plot(hz[shown], feeling.residual.bands[shown], "x-", color=GREEN, markersize=3, label="difference")
    if feeling.noise is not None:
        axes.plot(hz[shown], feeling.noise[shown], ":", color=VERMILLION, label="noise")
    axes.set_xscale("log")
    axes.set_xticks(_TICKS, [str(tick) for tick in _TICKS])
    axes.xaxis.set_minor_formatter(NullFormatter())
    smallest = feeling.residual.bands if feeling.noise is None else feeling.noise
    bottom = float(feeling.pressing_db[shown].min()) - _SHOWN_DB
    axes.set_ylim(bottom=max(bottom, float(smallest[shown].min()) - 5))
    axes.set_ylabel("Level (dB re 1 µm/s²)")


def _time(axes: Axes, feeling: Feeling) -> None:
    drawn = [(feeling.measured_level, VERMILLION, 0.8, "measured")]
    if feeling.recorded_level is not None:
        drawn.insert(0, (feeling.recorded_level, GREY, 1.8, "recorded press"))
    top = max(float(level.max()) for level, *_ in drawn)
    loud = np.flatnonzero(np.max([level for level, *_ in drawn], axis=0) > top - _SHOWN_DB / 2)
    part = slice(loud[0], loud[-1] + 1) if np.isfinite(top) and len(loud) else slice(None)
    milliseconds = 1e3 * np.arange(len(feeling.measured_level))[part] / feeling.rate_hz
    axes.axhline(0, color=INK, linewidth=1.2)
    for level, ink, width, label in drawn:
        axes.plot(milliseconds, level[part], color=ink, linewidth=width, label=label)
    act = feeling.pressing.act
    axes.axhspan(-act.lower, act.higher, color=GREY, alpha=0.25, linewidth=0)
    if np.isfinite(top):
        axes.set_ylim(min(top, 0) - _SHOWN_DB / 1.5, max(top, 0) + 6)
    axes.set_ylabel("Level of 20 ms (dB)")


_MARKS = "os^Dv"


def plan_figure(plans: Sequence[ButtonPlan], columns: Columns = 2) -> Figure:
    """Draw, for each button, the expected error of what the limits allow over its level above threshold."""
    with style():
        figure, grid = panels((len(plans) + 1) // 2, min(len(plans), 2), 2.1, columns)
        places = [axes for row in grid for axes in row]
        for number, (plan, axes) in enumerate(zip(plans, places, strict=False)):
            rows = (len(plan.curves) + 3) // 2 if number < 2 else 0
            letter(axes, number, capital(plan.button), rows)
            _draw(axes, plan)
            if number < 2:
                legend_under(axes, 2)
        for axes in places[len(plans) :]:
            axes.remove()
        return figure


def _draw(axes: Axes, plan: ButtonPlan) -> None:
    act = plan.sensation(plan.curves[0].offers[0]).act
    axes.axvspan(-act.lower, act.higher, color=GREY, alpha=0.25, linewidth=0, label="threshold may lie here")
    axes.axvline(0, color=INK, linewidth=1.2)
    axes.axhline(100 * TOLERANCE, color=INK, linestyle=":", linewidth=0.8)
    for number, curve in enumerate(plan.curves):
        axes.plot(
            [one.level for one in curve.offers],
            [100 * one.error for one in curve.offers],
            color=colour(number),
            linestyle=dash(number),
            marker=_MARKS[number % len(_MARKS)],
            markersize=3.5,
            label=f"{curve.method}, {curve.patch}",
        )
        axes.plot(
            [one.level for one in curve.offers],
            [100 * one.drifted for one in curve.offers],
            color=colour(number),
            linestyle=dash(number),
            linewidth=0.7,
            marker=_MARKS[number % len(_MARKS)],
            markersize=3.5,
            fillstyle="none",
            label=f"_{curve.method}, {curve.patch}, drifted",
        )
    axes.plot(
        [],
        [],
        color=GREY,
        linestyle="none",
        marker="o",
        markersize=3.5,
        fillstyle="none",
        label="after a drift",
    )
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MultipleLocator(5))
    axes.set_xlabel("Level above threshold, pressing (dB)")
    axes.set_ylabel("Expected error (%)")
