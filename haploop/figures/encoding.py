"""A figure as the bytes of a PNG, PDF or SVG: laid out once, drawn once, the same every time."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from haploop.figures.plotting import SOFT, style

__all__ = ["FORMATS", "encode", "lay_out", "mark_simulated", "png"]

DPI = 200.0
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
    return canvas


def encode(figure: Figure, kind: str = "png", dpi: float = DPI) -> bytes:
    """Encode a figure as PNG, PDF or SVG bytes, reproducibly: without a date or program name."""
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
    canvas.print_png(buffer, metadata={"Software": None})


def _pdf(canvas: FigureCanvasAgg, buffer: io.BytesIO) -> None:
    from matplotlib.backends.backend_pdf import FigureCanvasPdf  # noqa: PLC0415

    metadata: dict[str, Any] = {"CreationDate": None, "Creator": None, "Producer": None}
    FigureCanvasPdf(canvas.figure).print_pdf(buffer, metadata=metadata)


def _svg(canvas: FigureCanvasAgg, buffer: io.BytesIO) -> None:
    from matplotlib.backends.backend_svg import FigureCanvasSVG  # noqa: PLC0415

    FigureCanvasSVG(canvas.figure).print_svg(buffer, metadata={"Date": None, "Creator": None})


FORMATS: dict[str, Callable[[FigureCanvasAgg, io.BytesIO], None]] = {"png": _png, "pdf": _pdf, "svg": _svg}
"""Formats of a picture, which are also the suffixes of its file."""
