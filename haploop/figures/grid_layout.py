"""Layout of one grid of panels, measured once where matplotlib's constrained layout measures twice."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import LayoutEngine
from numpy.typing import ArrayLike

from haploop.instruments.arrays import FloatArray

__all__ = ["GridLayout"]

_PAD = 0.05
"""Inches around each panel with what is written beside it."""
_USUAL = ((0.5, 0.1), (0.2, 0.3))
"""Inches usually needed left and right of a panel, above and below it."""


class GridLayout(LayoutEngine):
    """Makes the panels of a figure as large as what is written beside them permits, all in line.

    The room for labels is measured with the panels where they usually come to stand. Constrained layout, with
    the same result to a pixel or two, measures from any place, hence twice: a tenth of the time of a report.
    For panels of one grid only, and without colour bars or a legend of the whole figure.
    """

    _adjust_compatible = True
    _colorbar_gridspec = False

    def __init__(self) -> None:
        super().__init__()
        self._params = {"rect": (0.0, 0.0, 1.0, 1.0)}

    def set(self, *, rect: tuple[float, float, float, float]) -> None:  # type: ignore[override]
        """Lay out within `rect` only: left, bottom, width, height, as shares of the figure."""
        self._params["rect"] = rect

    def execute(self, fig: Figure) -> None:
        """Place the panels of `fig`."""
        cells = [(axes, cell) for axes in fig.axes if (cell := axes.get_subplotspec()) is not None]
        rows, columns = cells[0][1].get_gridspec().get_geometry()
        self._place(fig, cells, np.tile(_USUAL[0], (columns, 1)), np.tile(_USUAL[1], (rows, 1)))
        across, down = np.zeros((columns, 2)), np.zeros((rows, 2))
        for axes, cell in cells:
            panel, whole = axes.get_window_extent(), axes.get_tightbbox(for_layout_only=True)
            if whole is not None:
                beside = np.array([panel.x0 - whole.x0, whole.x1 - panel.x1]) / fig.dpi + _PAD
                over = np.array([whole.y1 - panel.y1, panel.y0 - whole.y0]) / fig.dpi + _PAD
                for margins, span, needed in ((across, cell.colspan, beside), (down, cell.rowspan, over)):
                    for side, at in enumerate((span.start, span.stop - 1)):
                        margins[at, side] = max(margins[at, side], needed[side])
        self._place(fig, cells, across, down)

    def _place(
        self, fig: Figure, cells: list[tuple[Axes, SubplotSpec]], across: FloatArray, down: FloatArray
    ) -> None:
        """Place the panels with margins (inches) left and right of each column, above and below each row."""
        left, bottom, width, height = self._params["rect"]
        grid = cells[0][1].get_gridspec()
        x = _edges(across / fig.get_figwidth(), width, grid.get_width_ratios())
        y = _edges(down / fig.get_figheight(), height, grid.get_height_ratios())
        for axes, cell in cells:
            x0, x1 = x[cell.colspan.start][0], x[cell.colspan.stop - 1][1]
            y1, y0 = y[cell.rowspan.start][0], y[cell.rowspan.stop - 1][1]
            if x1 > x0 and y0 > y1:  # else labels leave no room, and it stays where it is
                axes.set_position((left + x0, bottom + height - y0, x1 - x0, y0 - y1))


def _edges(margins: FloatArray, room: float, ratios: ArrayLike) -> list[tuple[float, float]]:
    """Begin and end of each column's panels, in order, with `margins` (columns, 2) before and after it."""
    sizes = (room - margins.sum()) * np.asarray(ratios) / np.sum(ratios)
    ends = list(accumulate(margins.sum(axis=1) + sizes))
    return [
        (end - after - size, end - after)
        for end, size, (_, after) in zip(ends, sizes.tolist(), margins.tolist(), strict=True)
    ]
