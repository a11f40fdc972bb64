"""Figure of a force-travel curve."""

from __future__ import annotations

from matplotlib.figure import Figure

from ...exchange.importing import Curve
from .plotting import BLUE, GREEN, INK, ORANGE, VERMILLION, Columns, legend_under, panels, style


def curve_figure(curve: Curve, columns: Columns = 2) -> Figure:
    """Draw the force (N) over the travel (mm) of both strokes, and the points that were found."""
    with style():
        figure, grid = panels(1, 1, 2.2, columns)
        axes = grid[0, 0]
        axes.plot(1e3 * curve.down_travel, curve.down_force, color=BLUE, linewidth=0.9, label="Down")
        if len(curve.up_travel):
            axes.plot(1e3 * curve.up_travel, curve.up_force, color=ORANGE, linewidth=0.9, label="Up")
        for label, point, color in (
            ("Tactile peak", curve.peak, VERMILLION),
            ("Operating point", curve.operates, GREEN),
            ("Bottom-out", curve.bottom, INK),
        ):
            if point is not None:
                axes.plot(1e3 * point.travel, point.force, "o", color=color, markersize=3, label=label)
        axes.set_xlabel("Travel (mm)")
        axes.set_ylabel("Force (N)")
        legend_under(axes, 3)
    return figure
