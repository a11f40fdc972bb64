"""A report as a page of HTML that needs no other file, and as a PDF: the same facts, and the same figures.

Where results have a glance, the page opens with these, and all else is folded below. The same results give
the same bytes.
"""

from __future__ import annotations

import base64
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from ...terminal.progress import SIMULATED
from ..contents import Contents, Glance, Grid, Verdict, one_style, text_of, unbroken
from ..figures import encode, mark_simulated, on_page, pdf_of, text_page

GLANCE_STYLE = Path(__file__).with_name("glance.css")
"""Style of glances: part of a report, and of a notebook's cell; the console serves it to its pages."""
_LINES = 72
"""Lines of text on a page of the PDF."""
_WORDS = 105
"""Characters on a line."""


@dataclass(frozen=True, eq=False)
class CaptionedFigure:
    """A figure with its title and its caption, drawn once and placed on each page; marked if simulated.

    All formats of it are made before a PDF places it on a page of its own.
    """

    figure: Figure
    title: str
    caption: str
    simulated: bool

    def __post_init__(self) -> None:
        if self.simulated:
            mark_simulated(self.figure)

    @cached_property
    def svg(self) -> bytes:
        """The figure as SVG, encoded once: a page embeds it, and a file beside the page holds it."""
        return encode(self.figure, "svg")


@dataclass(frozen=True, eq=False)
class Page:
    """A report: what its results say, and its figures."""

    title: str
    lead: str
    sections: Sequence[Contents]
    figures: Sequence[CaptionedFigure] = ()
    sources: Sequence[tuple[str, str]] = ()
    """Name and SHA-256 of the content of each file that was read."""

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

    def pdf(self) -> bytes:
        """The report as a PDF of A4 pages. The figures are placed on them, and are of no further use."""
        return pdf_of(self._pages())

    def _pages(self) -> Iterator[Figure]:
        lines = list(self._lines())
        for first in range(0, len(lines), _LINES):
            yield text_page(lines[first : first + _LINES])
        for number, one in enumerate(self.figures, 1):
            yield on_page(one.figure, f"Figure {number}. {one.title}.", one.caption)

    def _lines(self) -> Iterator[tuple[str, bool]]:
        """Yield lines of text, and whether each is bold."""
        yield self.title, True
        yield self.lead, False
        if self.simulated:
            yield SIMULATED, True
        yield "", False
        if self.verdicts:
            yield "Verdicts", True
            for one in self.verdicts:
                told = "; ".join((f"{one.subject}: {one.said}", one.measured, *one.answers))
                yield from _wrapped(f"{told}. {one.why}" if one.why else told)
            yield "", False
        for section in self.sections:
            yield section.title, True
            for text in _told(section):
                yield from _wrapped(text)
            yield "", False
        if self.sources:
            yield "Data", True
            for name, digest in self.sources:
                yield from _wrapped(f"{name}: SHA-256 {digest}")


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
    return environment


def _shown(value: object) -> object:
    """What a page shows of a value: numbers stay with their units."""
    return unbroken(value) if type(value) is str else value


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
    table = [[label, *("; ".join(found.get(label, [])) for found in cells)] for label in labels]
    headings = ["", *(section.title for section in sections)]
    first = sections[0]
    return replace(
        first,
        title=f"Each {first.kind} in numbers",
        facts=(),
        tables=[Grid("", headings, table, words=len(headings)), *(t for one in sections for t in one.tables)],
        notes=list(dict.fromkeys(note for one in sections for note in one.notes)),
    )


def _told(section: Contents) -> Iterator[str]:
    """What a section says, as text: a row of a table becomes a line."""
    for label, cell in section.rows:
        yield f"{label}: {text_of(cell)}" if label else text_of(cell)
    for grid in section.tables:
        if grid.title:
            yield f"{grid.title}:"
        for first, *others in grid.rows:
            cells = zip(grid.headings[1:], others, strict=True)
            told = "; ".join(f"{heading} {text_of(cell)}" for heading, cell in cells if text_of(cell))
            yield f"{text_of(first)}: {told}"
        if grid.below:
            yield grid.below
    yield from section.said


def _wrapped(text: str) -> Iterator[tuple[str, bool]]:
    for line in textwrap.wrap(one_style(text), _WORDS, subsequent_indent="    ", break_on_hyphens=False):
        yield line, False
