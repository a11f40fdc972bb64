"""Figure of a digital button: target and measured acceleration, and the iterations of its drive."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haploop.calibration import DigitalButton
from haploop.figures.plotting import active, colour, legend_above, letter, new_figure, style

__all__ = ["button_figure"]


def button_figure(button: DigitalButton) -> Figure:
    """Draw target and measured acceleration, third octaves, and each iteration's error over the floor."""
    check, drive = button.check, button.drive
    with style():
        drawn = new_figure(2.6)
        whole, bands, errors = drawn.subplots(1, 3, width_ratios=[2, 1, 1])
        begin, end = active(drive.target, drive.rate_hz)
        part = slice(max(0, round(begin * drive.rate_hz)), round(end * drive.rate_hz))
        milliseconds = 1e3 * np.arange(part.start, part.stop)[: len(drive.target[part])] / drive.rate_hz
        whole.plot(milliseconds, drive.target[part], color=colour(0), label="target")
        whole.plot(milliseconds, check.measured[part], color=colour(1), linestyle="--", label="measured")
        whole.set_xlabel("Time (ms)")
        whole.set_ylabel("Acceleration (m/s²)")
        legend_above(whole, 2)
        bands.semilogx(check.octaves_hz, check.target_db, "o-", color=colour(0), markersize=3)
        bands.semilogx(check.octaves_hz, check.measured_db, "s--", color=colour(1), markersize=3)
        bands.set_xlabel("Third octave (Hz)")
        bands.set_ylabel("Level (dB re 1 m/s²)")
        _learning(errors, button)
        for index, axes in enumerate((whole, bands, errors)):
            letter(axes, index)
    return drawn


def _learning(axes: Axes, button: DigitalButton) -> None:
    tried = button.learning.iterations
    numbers = np.arange(len(tried))
    values = np.array([100 * i.nrmse for i in tried])
    kept = np.array([i.kept for i in tried])
    axes.plot(numbers[kept], values[kept], "o-", color=colour(0), markersize=4, label="kept")
    axes.plot(numbers[~kept], values[~kept], "x", color=colour(0), markersize=4, label="not kept")
    axes.plot(numbers, [100 * i.floor for i in tried], "--", color=colour(1), label="floor")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("Iteration")
    axes.set_ylabel("Error (%)")
    axes.set_xticks(numbers)
    legend_above(axes, 2)
