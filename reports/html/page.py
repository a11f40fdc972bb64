"""A report as a page of HTML that needs no other file.

Where results have a glance, the page opens with these, and all else is folded below. The same results give
the same bytes.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from .. import figures
from ..contents import Contents, Glance, Grid, Verdict, key_of, text_of, unbroken

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GLANCE_STYLE = Path(__file__).with_name("glance.css")
"""Style of glances: part of a report, and of a notebook's cell; the console serves it to its pages."""


@dataclass(frozen=True, eq=False)
class CaptionedFigure:
    """A figure with its title and its caption; marked if simulated."""

    figure: Figure
    title: str
    caption: str
    simulated: bool
    beside: str = ""
    """Where the figure's files are, from the page, without their suffix; empty where there are none."""

    def __post_init__(self) -> None:
        if self.simulated:
            figures.mark_simulated(self.figure)

    @cached_property
    def svg(self) -> bytes:
        """The figure as SVG, encoded once: a page embeds it, and a file beside the page holds it."""
        return figures.encode(self.figure, "svg")


@dataclass(frozen=True, eq=False)
class Page:
    """A report: what its results say, and its figures."""

    title: str
    lead: str
    sections: Sequence[Contents]
    figures: Sequence[CaptionedFigure] = ()
    sources: Sequence[tuple[str, str]] = ()
    """Name and SHA-256 of the content of each file that was read."""
    figures_by: str = ""
    """The command that writes figures of these files, where none are beside the page."""

    @property
    def verdicts(self) -> list[Verdict]:
        """The verdicts of all sections."""
        return [verdict for section in self.sections for verdict in section.verdicts]

    @property
    def simulated(self) -> str:
        """Whether "all" or "some" of the sections are simulated; "" for none."""
        said = [section.simulated for section in self.sections if section.simulated is not None]
        return "all" if said and all(said) else "some" if any(said) else ""

    @property
    def glances(self) -> list[Glance]:
        """What the first screen shows."""
        return [glance() for section in self.sections for glance in section.glances]

    @property
    def folded(self) -> list[Contents]:
        """The sections, those of neighbours of one kind side by side in one table."""
        found: list[Contents] = []
        for (_, alike), group in groupby(self.sections, lambda one: (one.kind, bool(one.glances))):
            some = list(group)
            found += [_side_by_side(some)] if alike and len(some) > 1 else some
        return found

    def html(self) -> str:
        """The report as HTML; figures are embedded as SVG."""
        images = [(one, base64.b64encode(one.svg).decode("ascii")) for one in self.figures]
        return _environment().get_template("page.html").render(page=self, images=images)


def glances_html(glances: Sequence[Glance]) -> str:
    """Glances as a part of another page, whose style is `GLANCE_STYLE`."""
    parts: Any = _environment().get_template("parts.html").make_module()
    return str(parts.glances(glances))


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("haploop.reports.html", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.finalize = _shown
    environment.globals["key_of"] = key_of
    return environment


def _shown(value: object) -> object:
    """What a page shows of a value: numbers stay with their units."""
    return unbroken(value) if type(value) is str else value


def _joined(told: Sequence[str]) -> str:
    """Sentences one after the other, other texts as a list."""
    return (" " if all(one.endswith(".") for one in told) else "; ").join(told)


def _side_by_side(sections: Sequence[Contents]) -> Contents:
    """Sections of one kind as one: a table with a column for each, and the notes that any of them has."""
    columns = [section.rows for section in sections]
    labels: dict[str, None] = {}
    cells: list[dict[str, list[str]]] = []
    for rows in columns:
        found: dict[str, list[str]] = {}
        label = ""
        for own, cell in rows:
            label = own or label
            found.setdefault(label, []).append(text_of(cell))
        labels |= dict.fromkeys(found)
        cells.append(found)
    table = [[label, *(_joined(found.get(label, [])) for found in cells)] for label in labels]
    headings = ["", *(section.title for section in sections)]
    first = sections[0]
    return replace(
        first,
        title=f"Each {first.kind} in numbers",
        facts=(),
        tables=[Grid("", headings, table, words=len(headings)), *(t for one in sections for t in one.tables)],
        notes=list(dict.fromkeys(note for one in sections for note in one.notes)),
    )
