"""Where results are to be written: refused before anything is measured, not after it."""

from __future__ import annotations

from pathlib import Path

from acquisition.store import check_target
from instruments import ConfigurationError

__all__ = ["new_file", "new_picture"]


def new_file(path: Path) -> None:
    """Refuse what could not be written as a new file: ConfigurationError."""
    if path.exists():
        raise ConfigurationError(f"{path} exists, and nothing is overwritten: name another file.")
    if not path.parent.is_dir():
        raise ConfigurationError(f"There is no folder {path.parent} to write {path.name} to.")
    check_target(path)


def new_picture(path: Path, suffix: str = ".png") -> None:
    """As `new_file`, for a picture: a recording must not become one."""
    if path.suffix.lower() != suffix:
        raise ConfigurationError(f"{path} is no name for a picture: it must end with {suffix}.")
    new_file(path)
