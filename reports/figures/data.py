"""A figure as a table of numbers: every curve, point, bar and map cell that it draws."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, QuadMesh
from matplotlib.container import BarContainer
from matplotlib.figure import Figure

from ...base.arrays import FloatArray

_HEADINGS = ("panel", "curve", "x axis", "y axis", "x", "y", "value")
_DIGITS = 9
"""Significant digits: beyond those of any converter."""


def figure_csv(figure: Figure) -> bytes:
    """Encode what a figure draws as CSV (UTF-8): a row for each point, in the units of its axes.

    `value` is the colour's number of a map's cell, empty for curves.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_HEADINGS)
    for number, axes in enumerate(figure.axes):
        head = f"{chr(ord('a') + number)} {axes.get_title(loc='left') or axes.get_title()}".strip()
        labels = (_label(figure, axes, "x"), _label(figure, axes, "y"))
        for name, x, y, values in _drawn(axes):
            for one, other, value in zip(x, y, values, strict=True):
                number_of = "" if np.isnan(value) else f"{value:.{_DIGITS}g}"
                rows.writerow((head, name, *labels, f"{one:.{_DIGITS}g}", f"{other:.{_DIGITS}g}", number_of))
    return text.getvalue().encode("utf-8")


def _drawn(axes: Axes) -> Iterator[tuple[str, FloatArray, FloatArray, FloatArray]]:
    """Name, x, y and value of each thing in a panel; lines that mark a place on one axis only are none."""
    for number, line in enumerate(axes.get_lines(), 1):
        if line.get_transform().contains_branch(axes.transData) and line.get_transform() == axes.transData:
            x, y = (_numbers(values) for values in (line.get_xdata(orig=False), line.get_ydata(orig=False)))
            yield _named(line, number), x, y, np.full(len(x), np.nan)
    for number, one in enumerate(axes.collections, 1):
        if isinstance(one, PathCollection):
            points = np.asarray(one.get_offsets(), dtype=float).reshape(-1, 2)
            yield _named(one, number), points[:, 0], points[:, 1], np.full(len(points), np.nan)
        elif isinstance(one, QuadMesh):
            corners = np.asarray(one.get_coordinates(), dtype=float)
            middle = (corners[:-1, :-1] + corners[1:, 1:]) / 2
            yield _named(one, number), middle[..., 0].ravel(), middle[..., 1].ravel(), _cells(one.get_array())
    for number, image in enumerate(axes.get_images(), 1):
        cells = np.asarray(image.get_array(), dtype=float)
        if cells.ndim == 2:
            row, column = (one.ravel().astype(float) for one in np.indices(cells.shape))
            yield _named(image, number), column, row, _cells(cells)
    for number, bars in enumerate(axes.containers, 1):
        if isinstance(bars, BarContainer):
            x = np.array([bar.get_x() + bar.get_width() / 2 for bar in bars])
            y = np.array([bar.get_y() + bar.get_height() for bar in bars])
            yield _named(bars, number), x, y, np.full(len(x), np.nan)


def _numbers(values: Any) -> FloatArray:
    return np.asarray(values, dtype=float)


def _cells(values: Any) -> FloatArray:
    return np.asarray(np.ma.filled(np.ma.asarray(values, dtype=float), np.nan)).ravel()


def _named(one: Any, number: int) -> str:
    label = str(one.get_label() or "")
    return str(number) if not label or label.startswith("_") else label


def _label(figure: Figure, axes: Axes, which: str) -> str:
    """The label of an axis, or of the one that it shares it with."""
    own = str(getattr(axes, f"get_{which}label")())
    shared = getattr(axes, f"get_shared_{which}_axes")()
    spec = axes.get_subplotspec()
    beside = [
        other
        for other in figure.axes
        if other is not axes
        and (
            shared.joined(axes, other)
            or (spec and (there := other.get_subplotspec()) and _same(spec, there, which))
        )
    ]
    labels = (own, *(str(getattr(other, f"get_{which}label")()) for other in beside))
    return " ".join(next(filter(None, labels), "").split())


def _same(one: Any, other: Any, which: str) -> bool:
    """Whether two panels stand in one column (x) or in one row (y)."""
    span = "colspan" if which == "x" else "rowspan"
    return bool(getattr(one, span) == getattr(other, span))
