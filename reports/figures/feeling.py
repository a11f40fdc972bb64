"""Figure of what a finger would feel: third octaves against thresholds, and the level over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from ...base.wording import capital
from ...calibration import Feeling
from ...calibration.perception import shares
from .plotting import BLUE, GREEN, GREY, INK, VERMILLION, Columns, legend_under, letter, panels, style

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
    for level, colour, width, label in drawn:
        axes.plot(milliseconds, level[part], color=colour, linewidth=width, label=label)
    act = feeling.pressing.act
    axes.axhspan(-act.lower, act.higher, color=GREY, alpha=0.25, linewidth=0)
    if np.isfinite(top):
        axes.set_ylim(min(top, 0) - _SHOWN_DB / 1.5, max(top, 0) + 6)
    axes.set_ylabel("Level of 20 ms (dB)")
