"""Render a report as one self-contained HTML file, reproducibly for the same run."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from ..figures import mark_simulated, png

__all__ = ["CaptionedFigure", "render"]


@dataclass(frozen=True, eq=False)
class CaptionedFigure:
    """A figure with its title and its caption."""

    figure: Figure
    title: str
    caption: str
    simulated: bool

    @cached_property
    def marked(self) -> Figure:
        """The figure, with the word "simulated" where that is so."""
        if self.simulated:
            mark_simulated(self.figure)
        return self.figure


def render(
    summary: Mapping[str, Any], captioned: Sequence[CaptionedFigure], template: str = "report.html"
) -> str:
    """Render a summary as HTML with a template of this package; figures are embedded as PNG."""
    environment = Environment(
        loader=PackageLoader("haploop.reports.html", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(percent=_percent, fixed=_fixed, minute=_minute, rest=_rest)
    images = [
        {
            "title": one.title,
            "caption": one.caption,
            "data": base64.b64encode(png(one.marked)).decode("ascii"),
        }
        for one in captioned
    ]
    return environment.get_template(template).render(s=summary, figures=images)


def _percent(value: float | None, digits: int = 1) -> str:
    return "not measured" if value is None else f"{100 * value:.{digits}f} %"


def _fixed(value: float | None, digits: int = 2, unit: str = "") -> str:
    return "not measured" if value is None else f"{value:.{digits}f}{unit and ' ' + unit}"


def _minute(date: str) -> str:
    return f"{datetime.fromisoformat(date):%Y-%m-%d %H:%M} UTC"


def _rest(share: float | None) -> float | None:
    return None if share is None else 1 - share
