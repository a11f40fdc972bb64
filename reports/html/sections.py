"""What files and folders say, as sections of a report, and the figures that they have together, as files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...acquisition import Representative, content_hash, load_study
from ...base import hdf5
from ...base.files import check_destination, new_file
from ...base.progress import Progress
from ...calibration import History
from ..contents import (
    Contents,
    Drawing,
    file_contents,
    is_history,
    study_contents,
    study_figures,
)
from ..figures import Columns, encode
from ..satellites import owned
from .page import CaptionedFigure

_ORDER = ("forces", "presses", "pressed", "map", "response", "plan", "drives", "check", "motion", "feeling")
"""Names of figures in the order in which they stand in a report; others follow."""


@dataclass(frozen=True, eq=False)
class Section:
    """What one file or folder says, and the name and SHA-256 of the content of each file that was read."""

    contents: Contents
    sources: Sequence[tuple[str, str]]

    @property
    def origin(self) -> str:
        """The first source with the beginning of its hash, for a caption."""
        name, digest = self.sources[0]
        more = f" and {len(self.sources) - 1} more files" if len(self.sources) > 1 else ""
        return f"{name} (SHA-256 {digest[:12]}…){more}"


def contents_at(path: Path) -> Contents:
    """What a result, a study, a history of calibrations or a table of answers says. Raises DataError."""
    return read_section(path).contents


def read_section(path: Path, presses: Sequence[Representative] = ()) -> Section:
    """Read a result, a study, or a table of answers; a check beside its press. Raises DataError."""
    if path.suffix.lower() == ".csv":
        return _owned("answers", path)
    if path.name == "experiment.toml" or (path / "experiment.toml").is_file():
        return _owned("experiment", path.parent if path.name == "experiment.toml" else path)
    if path.suffix == ".toml" or (path.is_dir() and (path / "study.toml").is_file()):
        return _study(path)
    if is_history(path):
        active = History(path).active()
        return Section(file_contents(path), [(f"{path.resolve().name}, {active.name}", active.digest)])
    return Section(
        file_contents(path, presses),
        _files_of_map(path) if path.is_dir() else [(path.name, content_hash(path))],
    )


def read_sections(files: Sequence[Path], progress: Progress) -> list[Section]:
    """Read each file, a copy of another once, with its progress. Raises DataError."""
    presses = []
    sections: dict[tuple[str, ...], Section] = {}
    # A check is shown beside its press, wherever that is named.
    for path in files if len(files) > 1 else ():
        if path.suffix == ".h5" and hdf5.kind_of(path) == "representative":
            presses.append(Representative.load(path))
    for number, path in enumerate(files):
        progress("Read the data", number, len(files), "files")
        section = read_section(path, presses)
        sections.setdefault(tuple(digest for _, digest in section.sources), section)
    progress("Read the data", len(files), len(files), "files")
    return list(sections.values())


def _owned(kind: str, path: Path) -> Section:
    section: Callable[[Path], Section] = owned(f"section {kind}")
    return section(path)


def _study(path: Path) -> Section:
    study = load_study(path)
    progress = study.progress()
    sources = [(r.path.name, r.content_hash) for one in progress for r in one.recordings]
    if not sources:  # what it asks for stands in its file
        sources = [(study.path.name, hashlib.sha256(study.path.read_bytes()).hexdigest())]
    return Section(replace(study_contents(study, progress), figures=study_figures(study)), sources)


def _files_of_map(folder: Path) -> list[tuple[str, str]]:
    """One hash over the content of all measurements, whose number says nothing to a reader."""
    files = sorted(path for path in folder.glob("*.h5") if not path.name.startswith("modes-"))
    digests = "".join(content_hash(path) for path in files)
    return [(f"{folder.resolve().name}, {len(files)} files", hashlib.sha256(digests.encode()).hexdigest())]


def planned(sections: Sequence[Section]) -> list[tuple[Sequence[Section], Drawing]]:
    """The figures of all sections. What several results show alike goes into one figure, and once only."""
    groups: dict[tuple[str, str], list[tuple[Section, Drawing]]] = {}
    drawn = set()
    for section in sections:
        for one in section.contents.figures:
            if (one.name, one.identity) not in drawn:
                groups.setdefault((one.name, one.title), []).append((section, one))
            if one.identity is not None:
                drawn.add((one.name, one.identity))
    found = []
    for group in groups.values():
        size = group[0][1].several
        for some in (group[first : first + size] for first in range(0, len(group), size)):
            things = [thing for _, one in some for thing in one.things]
            found.append((list(dict.fromkeys(s for s, _ in some)), replace(some[0][1], things=things)))
    return sorted(found, key=lambda one: [*_ORDER, one[1].name].index(one[1].name))


def captioned(
    sections: Sequence[Section], drawing: Drawing, columns: Columns = 2, beside: str = ""
) -> CaptionedFigure:
    """Draw a figure of sections; its caption says of how much it is, on which rig, and from which files."""
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
    drawn = drawing.draw(drawing.things, columns)
    return CaptionedFigure(drawn, drawing.title, caption, simulated, beside)


def write_formats(figure: CaptionedFigure, stem: Path) -> list[Path]:
    """Write a figure as new files: PDF, SVG, and what it draws as CSV. Raises ConfigurationError."""
    written = []
    for kind in ("pdf", "svg", "csv"):
        written.append(stem.with_name(f"{stem.name}.{kind}"))
        write(written[-1], figure.svg if kind == "svg" else encode(figure.figure, kind))
    return written


def write(path: Path, content: bytes) -> None:
    """Write a new file, whole or not at all. Raises ConfigurationError where that is not possible."""
    check_destination(path)
    with new_file(path) as part:
        part.write_bytes(content)
