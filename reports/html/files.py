"""Reports as files: one HTML page with its figures, of files or a recalibration, and figures for a paper.

Figures are PDF, SVG and CSV; those for a paper are a lab's own data in a journal's column width.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from urllib.parse import quote

from ...base import hdf5
from ...base.errors import DataError, HaploopError
from ...base.files import check_destination, new_file, os_error_text, paths_of, private_files
from ...base.progress import Progress, silent
from ...calibration.recalibration import History, Outcome
from ..contents import Verdict, files_of, outcome_contents
from ..figures import Columns
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


_PAPER = {
    # Name of the drawing: number in the paper, and what it takes.
    "map": (3, "a vibration map"),
    "presses": (6, "recordings"),
    "pressed": (6, "recordings"),  # one press of each recording, where nothing has a representative one
    "forces": (7, "recordings with a force"),
    "drives": (8, "a digital button or a drive"),
    "motion": (9, "a digital button, or a check and its press"),
    "confusion": (13, "answers of an identification experiment"),
    "ratings": (14, "adjective ratings"),
}


@dataclass(frozen=True)
class PaperFigures:
    """What `write_figures` wrote."""

    files: tuple[Path, ...]
    missing: Mapping[int, str]
    """By number of a figure of the paper that is not there: what it takes."""
    simulated: bool


@private_files()
def write_figures(
    paths: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    paper: bool = False,
    columns: Columns = 2,
    progress: Progress = silent,
) -> PaperFigures:
    """Write the figures of files and folders into a new folder `out`, one or two columns of a journal wide.

    With `paper`, those of the paper alone, by its numbers: of a study's folder, its digital buttons,
    vibration maps and experiments as well. The same data give the same bytes; simulated ones say so. Raises
    ConfigurationError when `out` exists, DataError for data that cannot be read or have no such figure.
    """
    out = Path(out)
    check_destination(out)
    files = [file for path in paths_of(paths) for file in (_belonging(path) if paper else files_of(path))]
    sections = read_sections(files, progress)
    figures = planned(sections)
    if paper:
        names = {drawing.name for _, drawing in figures}
        wanted = _PAPER.keys() - ({"pressed"} if "presses" in names else set())
        figures = [one for one in figures if one[1].name in wanted]
    if not figures:
        raise DataError("These data have no such figure: name recordings, digital buttons or answers.")
    written: list[Path] = []
    written_of: dict[str, int] = {}
    for number, (some, drawing) in enumerate(figures):
        progress("Draw the figures", number, len(figures), "figures")
        name = f"figure-{_PAPER[drawing.name][0]}-{drawing.name}" if paper else drawing.name
        written_of[name] = written_of.get(name, 0) + 1
        name += f"-{written_of[name]}" if written_of[name] > 1 else ""
        written += write_formats(captioned(some, drawing, columns), out / name)
    progress("Draw the figures", len(figures), len(figures), "figures")
    drawn = {_PAPER[drawing.name][0] for _, drawing in figures} if paper else set()
    missing = {number: takes for number, takes in _PAPER.values() if paper and number not in drawn}
    return PaperFigures(tuple(written), missing, any(section.contents.simulated for section in sections))


def _belonging(path: Path) -> list[Path]:
    """What a study's folder holds for a paper; of any other path, what a report reads."""
    if not (path / "study.toml").is_file():
        return files_of(path)
    made = sorted(one for pattern in ("*.h5", "buttons/*.h5") for one in path.glob(pattern))
    buttons: dict[str, Path] = {}
    for one in made:
        if hdf5.kind_of(one) == "button":
            buttons.setdefault(one.name, one)
    experiments = [one.parent for one in sorted(path.glob("*/experiment.toml")) if _answered(one.parent)]
    maps = [
        one.parent for pattern in ("map.json", "*/map.json", "maps/*/map.json") for one in path.glob(pattern)
    ]
    recorded = [path] if any((path / "recordings").glob("*.h5")) else []
    return [*recorded, *sorted(set(maps)), *buttons.values(), *experiments]


def _answered(experiment: Path) -> bool:
    return any((experiment / "answers").rglob("session-*.jsonl"))
