"""A figure as the bytes of a PNG, PDF, SVG or CSV (what it draws, as numbers), the same every time."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection, QuadMesh
from matplotlib.container import BarContainer
from matplotlib.figure import Figure

from ...base.arrays import FloatArray
from .plotting import SOFT, style

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


DPI = 200.0
_NO_DATE: dict[str, Any] = {"CreationDate": None, "Creator": None, "Producer": None}
_STRIP = 0.15
"""Height (inches) of the strip below the panels that holds the word "simulated"."""


def mark_simulated(figure: Figure) -> None:
    """Write "simulated" below the panels of a figure, because a picture is passed on without its text."""
    height = figure.get_figheight() + _STRIP
    figure.set_figheight(height)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(rect=(0, _STRIP / height, 1, 1 - _STRIP / height))  # type: ignore[call-arg]
    figure.text(
        1 - 0.03 / figure.get_figwidth(),
        0.03 / height,
        "simulated",
        ha="right",
        va="bottom",
        fontsize=7,
        color=SOFT,
    )


def lay_out(figure: Figure, dpi: float = DPI) -> FigureCanvasAgg:
    """Place the panels of a figure once and for all, so that every format of it shows the same."""
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        # `savefig` would lay out again, and draw twice.
        figure.set_layout_engine("none")
        for axes in figure.axes:
            # The layout's last digits depend on the order in which its solver meets the panels.
            left, bottom, width, height = (round(e, 6) for e in axes.get_position(original=True).bounds)
            axes.set_position((left, bottom, width, height))
    return canvas


def encode(figure: Figure, kind: str = "png", dpi: float = DPI) -> bytes:
    """Encode a figure as PNG, PDF, SVG or CSV bytes, reproducibly: without a date or program name."""
    buffer = io.BytesIO()
    with style():
        canvas = lay_out(figure, dpi)
        FORMATS[kind](canvas, buffer)
        figure.set_dpi(dpi)
    return buffer.getvalue()


def png(figure: Figure, dpi: float = DPI) -> bytes:
    """Encode a figure as PNG bytes, reproducibly."""
    return encode(figure, "png", dpi)


def _png(canvas: FigureCanvasAgg, buffer: io.BytesIO) -> None:
    # A third less time than zlib's default level, for pictures that are a twentieth larger.
    canvas.print_png(buffer, metadata={"Software": None}, pil_kwargs={"compress_level": 2})  # type: ignore[no-untyped-call]


def _pdf(canvas: FigureCanvasAgg, buffer: io.BytesIO) -> None:
    from matplotlib.backends.backend_pdf import FigureCanvasPdf  # noqa: PLC0415

    FigureCanvasPdf(canvas.figure).print_pdf(buffer, metadata=_NO_DATE)  # type: ignore[no-untyped-call]


def _svg(canvas: FigureCanvasAgg, buffer: io.BytesIO) -> None:
    from matplotlib.backends.backend_svg import FigureCanvasSVG  # noqa: PLC0415

    FigureCanvasSVG(canvas.figure).print_svg(buffer, metadata={"Date": None, "Creator": None})  # type: ignore[no-untyped-call]


def _csv(canvas: FigureCanvasAgg, buffer: io.BytesIO) -> None:
    buffer.write(figure_csv(canvas.figure))


FORMATS: dict[str, Callable[[FigureCanvasAgg, io.BytesIO], None]] = {
    "png": _png,
    "pdf": _pdf,
    "svg": _svg,
    "csv": _csv,
}
"""Formats of a figure, which are also the suffixes of its file; CSV is what it draws, as numbers."""
