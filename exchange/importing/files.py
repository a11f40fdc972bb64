"""A file that is understood becomes a press."""

from __future__ import annotations

from pathlib import Path

from ...instruments import ConfigurationError
from ...instruments.files import make_folder, os_error_text, private_files
from .press import press_of
from .understanding import Understanding

__all__ = ["destination", "import_file"]


def destination(file: Path, folder: Path) -> Path:
    """The file in `folder` that a file is imported into; the folder is made. Raises ConfigurationError."""
    if folder.suffix.lower() == ".h5":
        raise ConfigurationError(f"{folder} is one file: name a folder for several.")
    try:
        with private_files():
            make_folder(folder)
    except OSError as error:
        raise ConfigurationError(f"{folder} cannot be made: {os_error_text(error)}.") from None
    return folder / f"{file.stem}.h5"


def import_file(found: Understanding, out: str | Path, activation: float | None = None) -> None:
    """Write what a file holds into `out`: see `import_press`."""
    found.require()
    press_of(found, activation).save(out)
