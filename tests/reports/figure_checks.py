"""What a reader would notice: texts that overlap or leave the canvas, and curves that look alike."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from haploop.reports.figures.encoding import lay_out
from haploop.reports.figures.plotting import style
from tests.reports.colour_vision import LEAST, nearest

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

        renderer.draw_text = noted
        try:
            figure.draw(renderer)
        finally:
            renderer.draw_text = draw
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


@dataclass(frozen=True)
class _Look:
    """What tells something with a name from its neighbours."""

    name: str
    colour: Any
    marks: tuple[object, ...]
    """Kind of artist, dashes, marker, hatching."""
    width: float


def alike(figure: Figure) -> list[str]:
    """Name each pair of things with names, of a panel or a legend, that somebody could not tell apart.

    Somebody is anybody: with any colour blindness, and with a print in grey.
    """
    groups: list[list[Any]] = [list(_named(axes.get_lines())) for axes in figure.axes]
    groups += [list(legend.legend_handles) for legend in figure.findobj(Legend)]
    wrong = []
    for group in groups:
        for one, other in combinations(map(_look, group), 2):
            widths = sorted((one.width, other.width))
            if one.marks != other.marks or widths[1] >= 1.5 * widths[0] > 0:
                continue
            difference, vision = nearest(one.colour, other.colour)
            if difference < LEAST and (one.name, other.name) != ("", ""):
                wrong.append(f"{one.name!r} looks like {other.name!r} ({vision}, {difference:.0f})")
    return sorted(set(wrong))


def _look(artist: Any) -> _Look:
    name = str(artist.get_label())
    if isinstance(artist, Line2D):
        marks = (artist.get_linestyle(), artist._dash_pattern, str(artist.get_marker()))
        return _Look(name, artist.get_color(), ("line", *marks), artist.get_linewidth())
    if isinstance(artist, Patch):
        return _Look(name, artist.get_facecolor(), ("area", artist.get_hatch()), 0.0)
    colours = artist.get_facecolor() if len(artist.get_facecolor()) else artist.get_edgecolor()
    return _Look(name, colours[0], (type(artist).__name__,), 0.0)


def _named(lines: Any) -> Iterator[Line2D]:
    return (line for line in lines if line.get_label() and not str(line.get_label()).startswith("_"))
