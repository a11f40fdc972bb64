"""Figures of a lab's own data for a paper: each as PDF, SVG and CSV, in a journal's column width."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...base import hdf5
from ...base.errors import DataError
from ...base.files import check_destination, paths_of, private_files
from ...base.progress import Progress, silent
from ..contents import files_of
from ..figures import Columns
from .sections import captioned, planned, read_sections, write_formats

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
