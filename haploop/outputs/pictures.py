"""Pictures as new files."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from haploop.calibration.files import os_error_text
from haploop.figures import mark_simulated, png
from haploop.instruments import ConfigurationError

__all__ = ["save_picture", "unwritten"]


def save_picture(figure: Figure, path: Path, simulated: bool) -> None:
    """Write a figure as a new PNG, marked if it shows simulated data. Raises ConfigurationError."""
    if simulated:
        mark_simulated(figure)
    content = png(figure)
    try:
        with path.open("xb") as file:
            file.write(content)
    except OSError as error:
        raise unwritten(path, error) from None


def unwritten(path: Path, error: OSError | RuntimeError) -> ConfigurationError:
    """The error of a file that could not be written."""
    return ConfigurationError(f"{path} cannot be written: {os_error_text(error)}.")
