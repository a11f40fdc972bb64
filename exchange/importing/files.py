"""A file that is understood becomes a recording, a press, or a curve."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from ...base.errors import ConfigurationError
from ...base.files import make_folder, os_error_text, private_files
from .curve import curve_of
from .press import press_of, presses_in
from .recording import recording_of
from .understood import Understanding


def becomes(found: Understanding, activation: float | None = None) -> Literal["recording", "press", "curve"]:
    """What a file is imported as, unless its mapping says: a recording when it holds several presses."""
    if found.mapping.make is not None:
        return found.mapping.make
    if activation is not None or "activation_s" in found.table.about or len(presses_in(found)) < 2:
        return "press"
    return "recording"


def destination(name: str, folder: Path) -> Path:
    """The file of a name in `folder`, which is made. Raises ConfigurationError."""
    if folder.suffix.lower() == ".h5":
        raise ConfigurationError(f"{folder} is one file: name a folder for several.")
    try:
        with private_files():
            make_folder(folder)
    except OSError as error:
        raise ConfigurationError(f"{folder} cannot be made: {os_error_text(error)}.") from None
    return folder / f"{name}.h5"


def import_file(found: Understanding, out: str | Path, activation: float | None = None) -> None:
    """Write what a file holds into `out`: see `becomes`, `press_of`, `recording_of` and `curve_of`.

    For example:

        >>> done = haploop.export_file("press.h5", "csv", "theirs.csv")
        >>> haploop.import_file(haploop.understand("theirs.csv"), "mine.h5")
        >>> haploop.load("mine.h5").button
        'latch'
    """
    found.require()
    if found.mapping.make == "curve":
        curve_of(found).save(out)
        return
    if becomes(found, activation) == "press":
        press_of(found, activation).save(out)
    else:
        recording_of(found, Path(out))
