"""A figure as the bytes of a PNG, PDF, SVG or CSV: laid out once, drawn once, the same every time."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .data import figure_csv
from .plotting import SOFT, style

DPI = 200.0
_NO_DATE: dict[str, Any] = {"CreationDate": None, "Creator": None, "Producer": None}
_STRIP = 0.15
"""Height (inches) of the strip below the panels that holds the word "simulated"."""
_MARK = "simulated"


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
        gid=_MARK,
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


_PAGE = (8.27, 11.69)
"""Inches; A4."""
_MARGIN, _TITLE = 0.58, 0.45
"""Inches: margin of a page; height of a title on it."""
_CAPTION_WORDS = 118
"""Characters on a line of a caption."""


def on_page(figure: Figure, title: str, caption: str) -> Figure:
    """Put a figure, drawn and marked, onto an A4 page, with its title above and its caption below."""
    width, height = _PAGE
    lines = textwrap.wrap(caption, _CAPTION_WORDS, break_on_hyphens=False)
    room = height - 2 * _MARGIN - _TITLE - 0.3 - 0.15 * len(lines)
    own = min(figure.get_figheight(), room)
    bottom = height - _MARGIN - _TITLE - own
    across = min(figure.get_figwidth(), width - 2 * _MARGIN)
    figure.set_size_inches(width, height)
    marks = [text for text in figure.texts if text.get_gid() == _MARK]
    for mark in marks:
        mark.set_position(((_MARGIN + across) / width, bottom / height))
    foot = bottom + _STRIP if marks else bottom
    rect = (_MARGIN / width, foot / height, across / width, (bottom + own - foot) / height)
    figure.set_layout_engine("constrained", rect=rect)
    for axes in figure.axes:
        axes.set_in_layout(True)  # `lay_out` has placed them on their own canvas
    with style():
        _line(figure, height - _MARGIN, title, 10, "bold")
        for number, line in enumerate(lines):
            _line(figure, bottom - 0.15 - 0.15 * number, line, 8)
    return figure


def text_page(lines: Sequence[tuple[str, bool]]) -> Figure:
    """Return an A4 page of lines of text, each with whether it is bold."""
    page = Figure(figsize=_PAGE)
    with style():
        for number, (line, bold) in enumerate(lines):
            _line(page, _PAGE[1] - _MARGIN - 0.145 * number, line, 8, "bold" if bold else "normal")
    return page


def _line(page: Figure, y: float, text: str, size: float, weight: str = "normal") -> None:
    """Write a line, `y` inches above the foot of the page. Its text may hold a dollar sign."""
    page.text(
        _MARGIN / _PAGE[0], y / _PAGE[1], text, va="top", fontsize=size, fontweight=weight, parse_math=False
    )


def pdf_of(pages: Iterable[Figure]) -> bytes:
    """Encode pages as one PDF, reproducibly."""
    from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages  # noqa: PLC0415

    buffer = io.BytesIO()
    with style(), PdfPages(buffer, metadata=_NO_DATE) as pdf:
        for page in pages:
            lay_out(page)
            FigureCanvasPdf(page).print_pdf(pdf)  # type: ignore[no-untyped-call]
    return buffer.getvalue()
