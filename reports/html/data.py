"""The report of files: one HTML page, its figures as PDF and SVG, and all of it as one PDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from ...instruments.files import check_destination, new_file, private_files
from ...instruments.progress import Progress, silent
from ..figures import encode
from ..show import files_of
from .answers import answers_section
from .drawings import Drawing, drawings
from .pages import pdf_pages
from .rendering import CaptionedFigure, render
from .sections import Section, Verdict, section

__all__ = ["Report", "write_report"]


@dataclass(frozen=True)
class Report:
    """What `write_report` wrote."""

    html: Path
    pdf: Path | None
    figures: tuple[Path, ...]
    """Each figure as PDF and as SVG."""
    simulated: bool
    verdicts: tuple[Verdict, ...]


@private_files()
def write_report(
    paths: Sequence[str | Path], out: str | Path, pdf: bool = False, progress: Progress = silent
) -> Report:
    """Write a report of recordings, studies, calibrations, maps, buttons and answers into new files.

    Of a folder that is neither a study nor a map, every file in it is read.
    `out` (HTML) holds facts, verdicts and figures, and needs no other file. Beside it, the folder
    `<out>-figures` holds each figure as PDF and SVG, and with `pdf` the file `<out>.pdf` the whole report.
    The same data give the same bytes. All files are readable by their owner only.

    Raises ConfigurationError when one of them exists or cannot be written, and DataError for data that cannot
    be read.
    """
    out = Path(out)
    folder, printed = out.with_name(f"{out.stem}-figures"), out.with_suffix(".pdf")
    for path in (out, folder, *((printed,) if pdf else ())):
        check_destination(path)
    sections: list[Section] = []
    files = [file for path in paths for file in files_of(Path(path))]
    for number, path in enumerate(files):
        progress("Read the data", number, len(files), "files")
        read = answers_section if path.suffix.lower() == ".csv" else section
        sections.append(read(path))
    progress("Read the data", len(files), len(files), "files")
    planned = list(drawings(sections))
    captioned: list[CaptionedFigure] = []
    written: list[Path] = []
    for number, one in enumerate(planned, 1):
        progress("Draw the figures", number - 1, len(planned), "figures")
        figure = CaptionedFigure(one.draw(), one.title, one.caption, one.simulated)
        captioned.append(figure)
        for kind in ("pdf", "svg"):
            path = folder / f"{number:02d}-{_name(one)}.{kind}"
            _write(path, encode(figure.marked, kind))
            written.append(path)
    progress("Draw the figures", len(planned), len(planned), "figures")
    summary = _summary(sections)
    if pdf:
        _write(printed, pdf_pages(summary, planned))
    _write(out, render(summary, captioned, "data.html").encode("utf-8"))
    return Report(
        out,
        printed if pdf else None,
        tuple(written),
        any(s.simulated for s in sections),
        tuple(verdict for s in sections for verdict in s.verdicts),
    )


def _name(one: Drawing) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in one.name)


def _summary(sections: Sequence[Section]) -> dict[str, object]:
    return {
        "title": "Report" if len(sections) > 1 else sections[0].title,
        "rig": ", ".join(dict.fromkeys(s.rig for s in sections if s.rig)) or "none",
        "simulated": any(s.simulated for s in sections),
        "sections": sections,
        "verdicts": [verdict for s in sections for verdict in s.verdicts],
        "sources": list(dict.fromkeys(source for s in sections for source in s.sources)),
        "software": metadata.version("haploop"),
    }


def _write(path: Path, content: bytes) -> None:
    check_destination(path)
    with new_file(path) as part:
        part.write_bytes(content)
