"""The files of one check: press, drive, check with every play, and plot."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from ...acquisition import Representative
from ...calibration import Check
from ...instruments.files import check_destination
from ..figures import comparison
from .pictures import save_picture

__all__ = ["check_files", "dated_check", "save_check"]


def save_check(out: Path, press: Representative, result: Check) -> None:
    """Save the inputs and results of a check in a folder. Raises ConfigurationError and DataError."""
    press_file, drive_file, check_file, picture = check_files(out, press.button)
    press.save(press_file)
    result.drive.save(drive_file)
    result.save(check_file)
    save_picture(comparison([(press, result)]), picture, result.simulated)


def dated_check(name: str) -> Path:
    """Return the file of a check for which none was named: new, dated, in the folder `checks`.

    Raises ConfigurationError if it cannot be written.
    """
    path = Path("checks") / f"{name}-{datetime.now(UTC):%Y%m%dT%H%M%S}.h5"
    check_destination(path)
    return path


def check_files(out: Path, button: str) -> tuple[Path, Path, Path, Path]:
    """Press, drive, check and picture that `save_check` writes."""
    names = (f"{button}-press.h5", f"{button}-drive.h5", f"{button}-check.h5", f"{button}-check.png")
    press, drive, check, picture = (out / name for name in names)
    return press, drive, check, picture
