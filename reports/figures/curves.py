"""Figure of force-travel curves."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from ...acquisition import Curve
from .plotting import BLUE, GREEN, INK, ORANGE, VERMILLION, Columns, legend_under, panels, style

_COLORS = (BLUE, ORANGE, GREEN, VERMILLION, INK, "0.6")


def curves_figure(curves: Sequence[Curve], columns: Columns = 2) -> Figure:
    """Draw the force (N) over the travel (mm) of curves, laid over each other, up strokes dashed.

    The tactile peak, the operating point and the bottom-out of each are marked.
    """
    with style():
        figure, grid = panels(1, 1, 2.2, columns)
        axes = grid[0, 0]
        marks = {"Tactile peak": "o", "Operating point": "s", "Bottom-out": "^"}
        for number, curve in enumerate(curves):
            color = _COLORS[number % len(_COLORS)]
            label = curve.button if len(curves) > 1 else "Down"
            axes.plot(1e3 * curve.down_travel, curve.down_force, color=color, linewidth=0.9, label=label)
            travel, force = 1e3 * curve.travel[curve.up], curve.force[curve.up]
            label = "Up" if len(travel) and not number else ""
            axes.plot(travel, force, "--", color=color, linewidth=0.7, label=label or None)
            for (name, mark), point in zip(
                marks.items(), (curve.peak, curve.operates, curve.bottom), strict=True
            ):
                if point is not None:
                    # One entry of the legend for each kind of point.
                    said = name if name not in axes.get_legend_handles_labels()[1] else None
                    axes.plot(1e3 * point.travel, point.force, mark, color=color, markersize=3, label=said)
        axes.set_xlabel("Travel (mm)")
        axes.set_ylabel("Force (N)")
        legend_under(axes, 3)
    return figure
