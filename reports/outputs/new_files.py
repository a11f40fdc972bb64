"""Checks of output files before anything is measured."""

from __future__ import annotations

from pathlib import Path

from ...instruments import ConfigurationError
from ...instruments.files import check_destination, new_file

__all__ = ["check_destination", "check_new_file", "check_new_picture", "new_file"]


def check_new_file(path: Path) -> None:
    """Raise ConfigurationError if `path` cannot be written as a new file."""
    if not path.parent.is_dir():
        raise ConfigurationError(
            f"There is no folder {path.parent} for {path.name}: create it, or choose another folder."
        )
    check_destination(path)


def check_new_picture(path: Path, suffixes: tuple[str, ...] = (".png", ".pdf", ".svg")) -> None:
    """Raise ConfigurationError if `path` cannot be written as a new picture with one of these suffixes."""
    if path.suffix.lower() not in suffixes:
        raise ConfigurationError(
            f"{path} has the wrong file type: use a name that ends with {' or '.join(suffixes)}."
        )
    check_new_file(path)
