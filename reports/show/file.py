"""Contents of a file written by haploop: as values, as a table, and as a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from ...acquisition import Recording, Representative, accepted_presses, find_presses, hdf5
from ...calibration import Calibration, Check, DigitalButton, Drive, Waveforms
from ...calibration.map import VibrationMap
from ...instruments import DataError
from ...terminal.progress import SIMULATED, print_json, print_line, print_table
from .. import figures, outputs
from .button import button_contents
from .calibration import calibration_contents, drive_contents, waveforms_contents
from .check import check_contents
from .map import map_contents
from .press import recording_contents, representative_contents

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..figures import Columns

__all__ = ["FileContents", "contents_of", "file_contents", "show_file"]


@dataclass(frozen=True, eq=False)
class FileContents:
    """Contents of a file."""

    values: dict[str, Any]
    """JSON values; `kind` and `simulated` are always present."""
    table: Table
    loaded: Any
    """The recording, representative press, calibration, drive, check, digital button or vibration map."""
    draw: Callable[..., Figure]
    """Draws the contents, `columns` (1 or 2) wide. Raises DataError when there is nothing to draw."""


def show_file(path: Path, as_json: bool, plot: Path | None = None, columns: Columns = 2) -> None:
    """Print the contents of a file written by haploop, and plot it into `plot` (PNG, PDF or SVG).

    Raises DataError for a file that is missing, damaged, or of another kind, and
    ConfigurationError when `plot` cannot be written.
    """
    if plot is not None:
        outputs.check_new_picture(plot)
    found = file_contents(path)
    values = found.values
    if plot is not None:
        outputs.save_picture(found.draw(columns=columns), plot, values["simulated"])
        values["plot"] = str(plot)
    if as_json:
        print_json(values)
        return
    print_table(found.table)
    if values["simulated"]:
        print_line(SIMULATED)
    if plot is not None:
        print_line(f"Plot: {plot}")


def file_contents(path: str | Path) -> FileContents:
    """Read the contents of a file, or of the folder of a vibration map.

    Raises DataError for a file that is missing, damaged, or of another kind.
    """
    path = Path(path)
    return contents_of(VibrationMap.load(path) if path.is_dir() else _LOADERS[_kind(path)](path))


def contents_of(value: Any) -> FileContents:  # noqa: PLR0911 - one for each kind of value
    """The contents of what a file holds. Raises DataError for damaged data, TypeError for anything else."""
    # Figures are named within functions: most of what is shown is not drawn, and matplotlib takes longest.
    match value:
        case Recording():
            pressed = find_presses(value)
            counted = accepted_presses(value, pressed)
            told = recording_contents(value, pressed, counted)
            return FileContents(*told, value, lambda **how: figures.recording_figure(value, counted, **how))
        case Representative():
            told = representative_contents(value)
            return FileContents(
                *told, value, lambda **how: figures.profiles([figures.Profile.of(value)], **how)
            )
        case Calibration():
            told = calibration_contents(value)
            return FileContents(*told, value, lambda **how: figures.response(value, **how))
        case Drive():
            told = drive_contents(value)
            return FileContents(*told, value, lambda **how: figures.drives([value], **how))
        case Check():
            told = check_contents(value)
            return FileContents(*told, value, lambda **how: figures.check_figure(value, **how))
        case DigitalButton():
            told = button_contents(value)
            return FileContents(*told, value, lambda **how: figures.button_figure(value, **how))
        case VibrationMap():
            told = map_contents(value)
            return FileContents(*told, value, lambda **how: figures.map_figure(value, **how))
        case Waveforms():
            return FileContents(*waveforms_contents(value), value, _no_figure)
    raise TypeError(f"{type(value).__name__} is nothing that haploop shows.")


def _no_figure(columns: Columns = 2) -> Figure:
    raise DataError("There is no plot of waveforms: plot the calibration that they belong to.")


_LOADERS: dict[str, Callable[[Path], Any]] = {
    "recording": Recording.open,
    "representative": Representative.load,
    "calibration": Calibration.load,
    "waveforms": Waveforms.load,
    "drive": Drive.load,
    "check": Check.load,
    "button": DigitalButton.load,
}
"""Functions that read each kind of file."""


def _kind(path: Path) -> str:
    """Kind of a file. Raises DataError for one that cannot be shown."""
    kind = hdf5.kind_of(path)
    if kind not in _LOADERS:
        raise DataError(f"{path} holds a {kind}, which `haploop show` cannot display.")
    return kind
