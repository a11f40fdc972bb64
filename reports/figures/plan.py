"""Figure of a button's plan: expected error over the level above threshold, for each method."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from ...base.wording import capital
from ...calibration import ButtonPlan
from ...calibration.drive import TOLERANCE
from .plotting import GREY, INK, Columns, colour, dash, legend_under, letter, panels, style

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
