"""What a reader would notice: texts that overlap or leave the canvas, and curves that look alike."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.collections import Collection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D

from haploop.figures.encoding import lay_out
from haploop.figures.plotting import style

Box = tuple[str, float, float, float, float]
"""Text, and its edges in pixels: left, bottom, right, top."""

_SLACK = 1.0
"""Pixels (at 200 dpi) by which the boxes of texts may touch."""


def drawn_texts(figure: Figure) -> list[Box]:
    """Every text that is really drawn, line by line, with its box."""
    found: list[Box] = []
    with style():
        canvas = lay_out(figure)
        renderer = canvas.get_renderer()
        # Once everything has its place, only the texts matter, and drawing the rest takes most of the time.
        for artist in figure.findobj(lambda one: isinstance(one, Line2D | Collection | AxesImage)):
            artist.set_visible(False)
        height = canvas.get_width_height(physical=True)[1]
        draw = renderer.draw_text

        def noted(*told: Any, **more: Any) -> None:
            _, x, y, s, prop, angle, *rest = told
            ismath = rest[0] if rest else more.get("ismath", False)
            w, h, below = renderer.get_text_width_height_descent(s, prop, ismath)
            turn = np.exp(1j * np.deg2rad(angle))
            corners = (x + 1j * (height - y)) + turn * np.array(
                [-1j * below, w - 1j * below, w + 1j * (h - below), 1j * (h - below)]
            )
            edges = (corners.real.min(), corners.imag.min(), corners.real.max(), corners.imag.max())
            found.append((s, *(float(edge) for edge in edges)))

        renderer.draw_text = noted  # type: ignore[method-assign]
        try:
            figure.draw(renderer)
        finally:
            renderer.draw_text = draw  # type: ignore[method-assign]
    return found


def overlaps(figure: Figure, texts: list[Box] | None = None) -> list[str]:
    """Name each pair of texts that overlap, and each text that leaves the canvas. Spoils the figure."""
    texts = texts or drawn_texts(figure)
    width, height = figure.get_size_inches() * figure.dpi
    wrong = [
        f"{text!r} leaves the canvas"
        for text, left, bottom, right, top in texts
        if min(left, bottom) < -_SLACK or right > width + _SLACK or top > height + _SLACK
    ]
    for (one, l1, b1, r1, t1), (other, l2, b2, r2, t2) in combinations(texts, 2):
        if min(r1, r2) - max(l1, l2) > _SLACK and min(t1, t2) - max(b1, b2) > _SLACK:
            wrong.append(f"{one!r} overlaps {other!r}")
    return wrong


def alike(figure: Figure) -> list[str]:
    """Name each pair of named curves of a panel that nobody could tell apart in grey."""
    wrong = []
    for axes in figure.axes:
        for one, other in combinations(_named(axes.get_lines()), 2):
            same = (one.get_linestyle(), one.get_marker()) == (other.get_linestyle(), other.get_marker())
            widths = sorted((one.get_linewidth(), other.get_linewidth()))
            if same and widths[1] < 1.5 * widths[0] and abs(_grey(one) - _grey(other)) < 0.15:
                wrong.append(f"{one.get_label()!r} looks like {other.get_label()!r} in grey")
    return wrong


def _named(lines: Any) -> Iterator[Line2D]:
    return (line for line in lines if line.get_label() and not str(line.get_label()).startswith("_"))


def _grey(line: Line2D) -> float:
    """Lightness of a line's colour (CIE L*, 0 to 1), which is what is left of it in grey."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(line.get_color())]
    luminance = float(np.dot([0.2126, 0.7152, 0.0722], linear))
    return (1.16 * luminance ** (1 / 3) - 0.16) if luminance > 0.008856 else 9.033 * luminance
