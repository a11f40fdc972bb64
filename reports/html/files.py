"""The report of files: one HTML page, its figures as PDF, SVG and CSV, and all of it as one PDF."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

from ...acquisition import content_hash, load_study
from ...calibration import History
from ...experiments import analyse_identification, analyse_ratings, read_rows
from ...instruments import DataError
from ...instruments.files import check_destination, new_file, paths_of, private_files
from ...instruments.progress import Progress, silent
from ..contents import (
    Contents,
    Drawing,
    Verdict,
    file_contents,
    files_of,
    identification_contents,
    is_history,
    ratings_contents,
    study_contents,
    study_figures,
)
from ..figures import encode
from .page import CaptionedFigure, Page

_ORDER = ("forces", "presses", "map", "response", "plan", "drives", "check", "motion", "feeling")
"""Names of figures in the order in which they stand in a report; others follow."""


@dataclass(frozen=True)
class Report:
    """What `write_report` wrote."""

    html: Path
    pdf: Path | None
    figures: tuple[Path, ...]
    """Each figure as PDF, as SVG, and what it draws as CSV."""
    simulated: bool
    verdicts: tuple[Verdict, ...]


@dataclass(frozen=True, eq=False)
class _Section:
    """What one file or folder says, and the name and SHA-256 of the content of each file that was read."""

    contents: Contents
    sources: Sequence[tuple[str, str]]

    @property
    def origin(self) -> str:
        """The first source with the beginning of its hash, for a caption."""
        name, digest = self.sources[0]
        more = f" and {len(self.sources) - 1} more files" if len(self.sources) > 1 else ""
        return f"{name} (SHA-256 {digest[:12]}…){more}"


@private_files()
def write_report(
    paths: str | Path | Sequence[str | Path],
    out: str | Path,
    pdf: bool = False,
    progress: Progress = silent,
) -> Report:
    """Write a report of recordings, studies, calibrations, maps, buttons and answers into new files.

    Of a folder that is neither a study nor a map, every file in it is read.
    `out` (HTML) holds facts, verdicts and figures, and needs no other file. Beside it, the folder
    `<out>-figures` holds each figure as PDF, SVG and CSV (what it draws), and with `pdf` the file `<out>.pdf`
    the whole report.
    The same data give the same bytes. All files are readable by their owner only.

    Raises ConfigurationError when one of them exists or cannot be written, and DataError for data that cannot
    be read.
    """
    out = Path(out)
    folder, printed = out.with_name(f"{out.stem}-figures"), out.with_suffix(".pdf")
    for path in (out, folder, *((printed,) if pdf else ())):
        check_destination(path)
    sections: list[_Section] = []
    files = [file for path in paths_of(paths) for file in files_of(path)]
    for number, path in enumerate(files):
        progress("Read the data", number, len(files), "files")
        sections.append(_section(path))
    progress("Read the data", len(files), len(files), "files")
    planned = _planned(sections)
    captioned: list[CaptionedFigure] = []
    written: list[Path] = []
    for number, (some, drawing) in enumerate(planned, 1):
        progress("Draw the figures", number - 1, len(planned), "figures")
        figure = _captioned(some, drawing)
        captioned.append(figure)
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in drawing.name)
        for kind in ("pdf", "svg", "csv"):
            written.append(folder / f"{number:02d}-{name}.{kind}")
            _write(written[-1], figure.svg if kind == "svg" else encode(figure.figure, kind))
    progress("Draw the figures", len(planned), len(planned), "figures")
    contents = [section.contents for section in sections]
    rigs = ", ".join(dict.fromkeys(one.rig for one in contents if one.rig)) or "none"
    page = Page(
        "Report" if len(contents) > 1 else contents[0].title,
        f"Rig: {rigs}; haploop {metadata.version('haploop')}.",
        contents,
        captioned,
        list(dict.fromkeys(source for section in sections for source in section.sources)),
    )
    content = page.html().encode("utf-8")
    if pdf:
        _write(printed, page.pdf())
    _write(out, content)
    return Report(out, printed if pdf else None, tuple(written), bool(page.simulated), tuple(page.verdicts))


def contents_at(path: Path) -> Contents:
    """What a result, a study, a history of calibrations or a table of answers says. Raises DataError."""
    return _section(path).contents


def _section(path: Path) -> _Section:
    """Read a result, a study, or a table of answers. Raises DataError."""
    if path.suffix.lower() == ".csv":
        return _Section(_answers(path), [(path.name, hashlib.sha256(path.read_bytes()).hexdigest())])
    if path.suffix == ".toml" or (path.is_dir() and (path / "study.toml").is_file()):
        return _study(path)
    if is_history(path):
        active = History(path).active()
        return _Section(file_contents(path), [(f"{path.resolve().name}, {active.name}", active.digest)])
    return _Section(
        file_contents(path), _files_of_map(path) if path.is_dir() else [(path.name, content_hash(path))]
    )


def _study(path: Path) -> _Section:
    study = load_study(path)
    progress = study.progress()
    sources = [(r.path.name, r.content_hash) for one in progress for r in one.recordings]
    if not sources:
        raise DataError(
            f"The study {study.file.name!r} has no recording yet: `haploop study run` makes them."
        )
    return _Section(replace(study_contents(study, progress), figures=study_figures(study)), sources)


def _files_of_map(folder: Path) -> list[tuple[str, str]]:
    """One hash over the content of all measurements, whose number says nothing to a reader."""
    files = sorted(path for path in folder.glob("*.h5") if not path.name.startswith("modes-"))
    digests = "".join(content_hash(path) for path in files)
    return [(f"{folder.resolve().name}, {len(files)} files", hashlib.sha256(digests.encode()).hexdigest())]


def _answers(path: Path) -> Contents:
    """Analyse a CSV of answers or of ratings, as `haploop analyse` does by default. Raises DataError."""
    rows, of = read_rows(path), f", {path.name}"
    if {"presented", "answered"} <= set(rows.columns):
        return identification_contents(analyse_identification(rows), rows.simulated, of)
    if {"pair", "rating"} <= set(rows.columns):
        return ratings_contents(analyse_ratings(rows), rows.simulated, of)
    raise DataError(
        f"{path} has neither the columns presented and answered nor pair and rating: name a table of "
        "`haploop experiment export`."
    )


def _planned(sections: Sequence[_Section]) -> list[tuple[Sequence[_Section], Drawing]]:
    """The figures of all sections. What several results show alike goes into one figure, and once only."""
    groups: dict[tuple[str, str], list[tuple[_Section, Drawing]]] = {}
    drawn = set()
    for section in sections:
        for one in section.contents.figures:
            if (one.name, one.identity) not in drawn:
                groups.setdefault((one.name, one.title), []).append((section, one))
            if one.identity is not None:
                drawn.add((one.name, one.identity))
    planned = []
    for group in groups.values():
        size = group[0][1].several
        for some in (group[first : first + size] for first in range(0, len(group), size)):
            things = [thing for _, one in some for thing in one.things]
            planned.append((list(dict.fromkeys(s for s, _ in some)), replace(some[0][1], things=things)))
    return sorted(planned, key=lambda one: [*_ORDER, one[1].name].index(one[1].name))


def _captioned(sections: Sequence[_Section], drawing: Drawing) -> CaptionedFigure:
    rigs = ", ".join(dict.fromkeys(f"“{s.contents.rig}”" for s in sections if s.contents.rig))
    simulated = any(s.contents.simulated for s in sections)
    caption = " ".join(
        [
            drawing.caption,
            drawing.count(drawing.things),
            *([f"Rig {rigs}."] if rigs else []),
            f"Data: {'; '.join(s.origin for s in sections)}.",
            *(["Simulated."] if simulated else []),
        ]
    )
    return CaptionedFigure(drawing.draw(drawing.things, 2), drawing.title, caption, simulated)


def _write(path: Path, content: bytes) -> None:
    check_destination(path)
    with new_file(path) as part:
        part.write_bytes(content)
