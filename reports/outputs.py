"""Files that a command writes: names checked before anything is measured, pictures, files of a check."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from ..base.errors import ConfigurationError
from ..base.files import check_destination, new_file, private_files
from . import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..acquisition import Representative
    from ..calibration import Check

__all__ = [
    "check_destination",
    "check_files",
    "check_new_file",
    "dated_check",
    "new_file",
    "save_check",
    "save_picture",
]

PICTURES = (".png", ".pdf", ".svg", ".csv")
"""Suffixes of a figure: pictures, and the numbers that it draws."""


def check_new_file(path: Path, suffixes: tuple[str, ...] = ()) -> None:
    """Raise ConfigurationError if `path` cannot be written as a new file with one of `suffixes`, if any."""
    if suffixes and path.suffix.lower() not in suffixes:
        raise ConfigurationError(
            f"{path} has the wrong file type: use a name that ends with {' or '.join(suffixes)}."
        )
    if not path.parent.is_dir():
        raise ConfigurationError(
            f"There is no folder {path.parent} for {path.name}: create it, or choose another folder."
        )
    check_destination(path)


@private_files()
def save_picture(figure: Figure, path: Path, simulated: bool) -> None:
    """Write a figure as a new PNG, PDF, SVG or CSV, by the suffix of `path`; marked if it is simulated.

    Its owner alone can read it, as a report: most figures show what people did.

    Raises ConfigurationError when it exists or its folder cannot be written, DataError when the disk fails.
    """
    if simulated:
        figures.mark_simulated(figure)
    content = figures.encode(figure, path.suffix.lower().removeprefix("."))
    check_destination(path)
    with new_file(path) as part:
        part.write_bytes(content)


def save_check(out: Path, press: Representative, result: Check) -> None:
    """Save the inputs and results of a check in a folder. Raises ConfigurationError and DataError."""
    press_file, drive_file, check_file, picture = check_files(out, press.button)
    press.save(press_file)
    result.drive.save(drive_file)
    result.save(check_file)
    save_picture(figures.comparison([(press, result)]), picture, result.simulated)


def dated_check(name: str) -> Path:
    """Return the file of a check for which none was named: new, dated, in the folder `checks`.

    Raises ConfigurationError if it cannot be written.
    """
    path = Path("checks") / f"{name}-{datetime.now(UTC):%Y%m%dT%H%M%S}.h5"
    check_destination(path)
    return path


def check_files(out: Path, button: str) -> tuple[Path, Path, Path, Path]:
    """Press, drive, check and picture that `save_check` writes."""
    press, drive, check = (out / f"{button}-{kind}.h5" for kind in ("press", "drive", "check"))
    return press, drive, check, out / f"{button}-check.png"
