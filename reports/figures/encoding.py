"""A figure as the bytes of a PNG, PDF, SVG or CSV: laid out once, drawn once, the same every time."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .data import figure_csv
from .plotting import SOFT, style

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
