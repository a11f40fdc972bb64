"""Save pictures as new files."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from ...instruments.files import check_destination, new_file, private_files
from ..figures import encode, mark_simulated

__all__ = ["save_picture"]


@private_files()
def save_picture(figure: Figure, path: Path, simulated: bool) -> None:
    """Write a figure as a new PNG, PDF or SVG, by the suffix of `path`; marked if it shows simulated data.

    Its owner alone can read it, as a report: most figures show what people did.

    Raises ConfigurationError when it exists or its folder cannot be written, DataError when the disk fails.
    """
    if simulated:
        mark_simulated(figure)
    content = encode(figure, path.suffix.lower().removeprefix("."))
    check_destination(path)
    with new_file(path) as part:
        part.write_bytes(content)
