"""Reports as one HTML page, their figures as PDF, SVG and CSV: of files, and of a recalibration."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from urllib.parse import quote

from ...base.errors import DataError, HaploopError
from ...base.files import check_destination, new_file, os_error_text, paths_of, private_files
from ...base.progress import Progress, silent
from ...calibration.recalibration import History, Outcome
from ..contents import Verdict, files_of, outcome_contents
from .page import CaptionedFigure, Page
from .sections import Section, captioned, planned, read_sections, write, write_formats


@dataclass(frozen=True)
class Report:
    """What `write_report` wrote."""

    html: Path
    figures: tuple[Path, ...]
    """Each figure as PDF, as SVG, and what it draws as CSV."""
    simulated: bool
    verdicts: tuple[Verdict, ...]


@private_files()
def write_report(
    paths: str | Path | Sequence[str | Path], out: str | Path, progress: Progress = silent
) -> Report:
    """Write a report of recordings, studies, calibrations, maps, buttons and answers into new files.

    Of a folder that is neither a study nor a map, every file in it is read.
    `out` (HTML) holds facts, verdicts and figures, and needs no other file. Beside it, the folder
    `<out>-figures` holds each figure as PDF, SVG and CSV (what it draws).
    The same data give the same bytes. All files are readable by their owner only.

    Raises ConfigurationError when one of them exists or cannot be written, and DataError for data that cannot
    be read.

    For example:

        >>> report = haploop.write_report("press.h5", "report.html")
        >>> report.html.name, len(report.figures)
        ('report.html', 3)
    """
    out = Path(out)
    folder = out.with_name(f"{out.stem}-figures")
    for path in (out, folder):
        check_destination(path)
    sections = read_sections([file for path in paths_of(paths) for file in files_of(path)], progress)
    figures = planned(sections)
    drawn: list[CaptionedFigure] = []
    written: list[Path] = []
    for number, (some, drawing) in enumerate(figures, 1):
        progress("Draw the figures", number - 1, len(figures), "figures")
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in drawing.name)
        stem = folder / f"{number:02d}-{name}"
        figure = captioned(some, drawing, beside=f"{quote(folder.name)}/{stem.name}")
        drawn.append(figure)
        written += write_formats(figure, stem)
    progress("Draw the figures", len(figures), len(figures), "figures")
    page = _page(sections, drawn)
    write(out, page.html().encode("utf-8"))
    return Report(out, tuple(written), bool(page.simulated), tuple(page.verdicts))


def report_html(path: Path, drawing: AbstractContextManager[object]) -> bytes:
    """The page of `write_report` alone. `drawing` is entered for each figure, and for nothing else.

    Raises DataError for data that cannot be read.
    """
    sections = read_sections(files_of(path), silent)
    drawn = []
    for some, one in planned(sections):
        with drawing:
            figure = captioned(some, one)
            figure.svg  # noqa: B018 (encoded here, and kept)
        drawn.append(figure)
    by = f"haploop figures {shlex.quote(path.name)} --out figures" if drawn else ""
    return replace(_page(sections, drawn), figures_by=by).html().encode("utf-8")


def _page(sections: Sequence[Section], drawn: Sequence[CaptionedFigure]) -> Page:
    contents = [section.contents for section in sections]
    rigs = ", ".join(dict.fromkeys(one.rig for one in contents if one.rig)) or "none"
    return Page(
        "Report" if len(contents) > 1 else contents[0].title,
        f"Rig: {rigs}; haploop {metadata.version('haploop')}.",
        contents,
        drawn,
        list(dict.fromkeys(source for section in sections for source in section.sources)),
    )


# The HTML report of a recalibration, with before and after.


def write_recalibration(history: History, outcome: Outcome) -> Path | None:
    """Write the report of a look into the history's `reports`, with a folder of its figures beside it; None
    for an unchanged table.

    Raises DataError when it cannot be written.
    """
    if outcome.kind == "unchanged":
        return None
    path = history.report(outcome.when, outcome.kind)
    contents = outcome_contents(history, outcome)
    figures = [
        CaptionedFigure(
            one.draw(one.things, 2), one.title, one.caption, outcome.simulated, f"{path.stem}/{one.name}"
        )
        for one in contents.figures
    ]
    html = Page(contents.title, f"haploop {metadata.version('haploop')}", [contents], figures).html()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for figure in figures:
            write_formats(figure, path.parent / figure.beside)
        with new_file(path) as part:
            part.write_text(html, encoding="utf-8", newline="\n")
    except (OSError, HaploopError) as error:
        said = str(error)
        if not isinstance(error, HaploopError):
            said = f"{path.parent} cannot be created: {os_error_text(error)}."
        raise DataError(
            f"The report could not be written: {said} The active calibration is {outcome.active.name}."
        ) from None
    return path
