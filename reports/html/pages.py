"""The pages of a printed report: verdicts and facts as text, then each figure with its caption."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from ...terminal.progress import SIMULATED
from ..figures import on_page, pdf_of, text_page
from .drawings import Drawing

__all__ = ["pdf_pages"]

_LINES = 72
"""Lines of text on a page."""
_WORDS = 105
"""Characters on a line."""


def pdf_pages(summary: Mapping[str, Any], planned: Sequence[Drawing]) -> bytes:
    """Return the report as the bytes of a PDF of A4 pages."""
    return pdf_of(_pages(summary, planned))


def _pages(summary: Mapping[str, Any], planned: Sequence[Drawing]) -> Iterator[Figure]:
    lines = list(_text(summary))
    for first in range(0, len(lines), _LINES):
        yield text_page(lines[first : first + _LINES])
    for number, one in enumerate(planned, 1):
        yield on_page(one.draw(), f"Figure {number}. {one.title}.", one.caption, one.simulated)


def _text(summary: Mapping[str, Any]) -> Iterator[tuple[str, bool]]:
    """Yield lines of text, and whether each is bold."""
    yield summary["title"], True
    yield f"Rig: {summary['rig']}, haploop {summary['software']}", False
    if summary["simulated"]:
        yield SIMULATED, True
    yield "", False
    if summary["verdicts"]:
        yield "Verdicts", True
        for verdict in summary["verdicts"]:
            told = f"{verdict.subject}: {verdict.said}; {verdict.measured}"
            yield from _wrapped(f"{told}. {verdict.why}" if verdict.why else told)
        yield "", False
    for section in summary["sections"]:
        yield section.title, True
        for name, text in section.facts:
            yield from _wrapped(f"{name}: {text}" if name else text)
        yield "", False
    yield "Data", True
    for name, digest in summary["sources"]:
        yield from _wrapped(f"{name}: SHA-256 {digest}")


def _wrapped(text: str) -> Iterator[tuple[str, bool]]:
    for line in textwrap.wrap(text, _WORDS, subsequent_indent="    ", break_on_hyphens=False):
        yield line, False
