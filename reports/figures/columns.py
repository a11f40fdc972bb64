"""Figures of a file of another program, as it was understood, and of force-travel curves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...base.arrays import FloatArray
from ...exchange.curve import Curve
from ...exchange.importing import Understanding, presses_in
from .plotting import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    SOFT,
    VERMILLION,
    Columns,
    legend_under,
    new_figure,
    panels,
    style,
)

_COLOURS = {"force": VERMILLION, "displacement": ORANGE, "acceleration": BLUE, "activation": GREEN}
_AXES = {
    "force": "force (N)", "displacement": "travel (mm)", "acceleration": "acceleration\n(m/s²)",
    "activation": "activation",
}  # fmt: skip
_MOST = 20_000
"""Points of a curve; more are drawn as the smallest and the largest of equal parts."""


def columns_figure(files: Sequence[Understanding], columns: Columns = 2) -> Figure:
    """Draw each signal of a file over time, with the presses found marked."""
    (found,) = files
    roles = [role for role in _COLOURS if role in found.signals and len(found.signals[role].values)]
    with style():
        figure = new_figure(0.4 + 1.1 * len(roles), columns)
        axes = figure.subplots(len(roles), 1, sharex=True, squeeze=False)[:, 0]
        for axis, role in zip(axes, roles, strict=True):
            values = found.signals[role].values * (1e3 if role == "displacement" else 1.0)
            time, curve = _thinned(values, found.rate_hz)
            axis.plot(time, curve, color=_COLOURS[role], linewidth=0.6)
            axis.set_ylabel(_AXES[role])
            for instant in presses_in(found):
                axis.axvline(instant, color=SOFT, linewidth=0.5, linestyle=":")
        axes[-1].set_xlabel("time (s)")
    return figure


def _thinned(values: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    width = max(1, -(-len(values) // (_MOST // 2)))
    if width == 1:
        return np.arange(len(values)) / rate_hz, values
    whole = values[: len(values) // width * width].reshape(-1, width)
    curve = np.stack([whole.min(axis=1), whole.max(axis=1)], axis=1).ravel()
    return np.arange(len(curve)) * width / 2 / rate_hz, curve


# Figure of force-travel curves.

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
