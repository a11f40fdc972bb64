"""Figures of a check and of a digital button: the motion beside its target, and the drive's iterations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from ...calibration import Check, DigitalButton, check_feeling
from .feeling import draw_feeling
from .plotting import BLUE, GREY, INK, ORANGE, Columns, active, legend_under, letter, new_figure, style


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
