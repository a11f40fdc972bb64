"""Figures of a check and of a digital button: the whole motion beside its target, the drive's iterations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haploop.calibration import Check, DigitalButton, Feeling, check_feeling
from haploop.figures.feeling import draw_feeling
from haploop.figures.plotting import GREY, active, colour, legend_above, letter, new_figure, style

__all__ = ["button_figure", "check_figure"]


def check_figure(check: Check) -> Figure:
    """Draw target and measured acceleration, third octaves with the plays' noise, and what is felt of it."""
    with style():
        drawn, panels = _panels("motion", "motion", "motion", "octaves")
        _check(panels, check, check_feeling(check))
    return drawn


def button_figure(button: DigitalButton) -> Figure:
    """Draw a button's check, what is felt of it, and each iteration's error over the plays' noise."""
    with style():
        drawn, panels = _panels("motion", "motion", "octaves", "learning")
        _learning(panels["learning"], button)
        _check(panels, button.check, check_feeling(button.check, button.press))
    return drawn


def _panels(*first_row: str) -> tuple[Figure, dict[str, Axes]]:
    drawn = new_figure(5.4)
    panels = drawn.subplot_mosaic([list(first_row), ["bands", "bands", "time", "time"]])
    # Room for the legends, which stand outside the layout, above each row.
    drawn.get_layout_engine().set(hspace=0.2, rect=(0, 0, 1, 0.92))  # type: ignore[union-attr,call-arg]
    for index, axes in enumerate(panels.values()):
        letter(axes, index)
    return drawn, panels


def _check(panels: dict[str, Axes], check: Check, feeling: Feeling) -> None:
    _motion(panels["motion"], check)
    _octaves(panels["octaves"], check)
    draw_feeling(panels["bands"], panels["time"], feeling)


def _motion(axes: Axes, check: Check) -> None:
    begin, end = active(check.target, check.rate_hz)
    part = slice(max(0, round(begin * check.rate_hz)), round(end * check.rate_hz))
    milliseconds = 1e3 * np.arange(len(check.target))[part] / check.rate_hz
    axes.plot(milliseconds, check.target[part], color=colour(0), label="target")
    axes.plot(milliseconds, check.measured[part], color=colour(1), linestyle="--", label="measured")
    axes.set_xlabel("Time (ms)")
    axes.set_ylabel("Acceleration (m/s²)")
    legend_above(axes, 2)


def _octaves(axes: Axes, check: Check) -> None:
    axes.semilogx(check.octaves_hz, check.target_db, "o-", color=colour(0), markersize=3)
    axes.semilogx(check.octaves_hz, check.measured_db, "s--", color=colour(1), markersize=3)
    axes.semilogx(check.octaves_hz, check.floor_db, ":", color=GREY, label="noise of the mean")
    # Outside the band the target is zero.
    axes.set_ylim(bottom=min(check.floor_db.min(), check.measured_db.min()) - 5)
    axes.set_xlabel("Third octave (Hz)")
    axes.set_ylabel("Level (dB re 1 m/s²)")
    legend_above(axes, 1)


def _learning(axes: Axes, button: DigitalButton) -> None:
    tried = button.learning.iterations
    numbers = np.arange(len(tried))
    values = np.array([100 * i.nrmse for i in tried])
    kept = np.array([i.kept for i in tried])
    axes.plot(numbers[kept], values[kept], "o-", color=colour(0), markersize=4, label="kept")
    axes.plot(numbers[~kept], values[~kept], "x", color=colour(0), markersize=4, label="not kept")
    axes.plot(numbers, [100 * i.floor for i in tried], "--", color=colour(1), label="noise")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("Iteration")
    axes.set_ylabel("Error in band (%)")
    axes.set_xticks(numbers)
    legend_above(axes, 2)
