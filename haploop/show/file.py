"""Contents of a file written by haploop: as values, as a table, and as a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.table import Table

from haploop import figures
from haploop.acquisition import Recording, Representative, accepted_presses, find_presses, hdf5
from haploop.calibration import Calibration, Check, DigitalButton, Drive, Waveforms
from haploop.calibration.map import VibrationMap
from haploop.figures import Columns
from haploop.instruments import DataError
from haploop.outputs import check_new_picture, save_picture
from haploop.progress import print_json, print_line, print_table
from haploop.show.button import button_contents
from haploop.show.calibration import calibration_contents, drive_contents, waveforms_contents
from haploop.show.check import check_contents
from haploop.show.formatting import SIMULATED
from haploop.show.map import map_contents
from haploop.show.press import recording_contents, representative_contents

__all__ = ["FileContents", "file_contents", "show_file"]


@dataclass(frozen=True, eq=False)
class FileContents:
    """Contents of a file."""

    values: dict[str, Any]
    """JSON values; `kind` and `simulated` are always present."""
    table: Table
    loaded: Any
    """The recording, representative press, calibration, drive, check, digital button, vibration map or waveforms."""
    draw: Callable[..., Figure]
    """Draws the contents, `columns` (1 or 2) wide. Raises DataError when there is nothing to draw."""


def show_file(path: Path, as_json: bool, plot: Path | None = None, columns: Columns = 2) -> None:
    """Print the contents of a file written by haploop, and plot it into `plot` (PNG, PDF or SVG).

    Raises DataError for a file that is missing, damaged, or of another kind, and
    ConfigurationError when `plot` cannot be written.
    """
    if plot is not None:
        check_new_picture(plot)
    found = file_contents(path)
    values = found.values
    if plot is not None:
        save_picture(found.draw(columns=columns), plot, values["simulated"])
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
    if path.is_dir():
        mapped = VibrationMap.load(path)
        return FileContents(*map_contents(mapped), mapped, partial(figures.map_figure, mapped))
    return _READERS[_kind(path)](path)


def _recording(path: Path) -> FileContents:
    recording = Recording.open(path)
    pressed = find_presses(recording)
    counted = accepted_presses(recording, pressed)
    return FileContents(
        *recording_contents(recording, pressed, counted),
        recording,
        partial(figures.recording_figure, recording, counted),
    )


def _representative(path: Path) -> FileContents:
    press = Representative.load(path)
    return FileContents(
        *representative_contents(press),
        press,
        partial(figures.profiles, [figures.Profile.of(press)]),
    )


def _calibration(path: Path) -> FileContents:
    calibration = Calibration.load(path)
    return FileContents(
        *calibration_contents(calibration),
        calibration,
        partial(figures.response, calibration),
    )


def _drive(path: Path) -> FileContents:
    drive = Drive.load(path)
    return FileContents(*drive_contents(drive), drive, partial(figures.drives, [drive]))


def _waveforms(path: Path) -> FileContents:
    def nothing(columns: Columns = 2) -> Figure:
        raise DataError(f"There is no plot of waveforms: plot the calibration that {path} belongs to.")

    waveforms = Waveforms.load(path)
    return FileContents(*waveforms_contents(waveforms), waveforms, nothing)


def _check(path: Path) -> FileContents:
    check = Check.load(path)
    return FileContents(*check_contents(check), check, partial(figures.check_figure, check))


def _button(path: Path) -> FileContents:
    button = DigitalButton.load(path)
    return FileContents(*button_contents(button), button, partial(figures.button_figure, button))


_READERS = {
    "recording": _recording,
    "representative": _representative,
    "calibration": _calibration,
    "waveforms": _waveforms,
    "drive": _drive,
    "check": _check,
    "button": _button,
}
"""Functions that read each kind of file."""


def _kind(path: Path) -> str:
    """Kind of a file. Raises DataError for one that cannot be shown."""
    kind = hdf5.kind_of(path)
    if kind not in _READERS:
        raise DataError(f"{path} holds a {kind}, which `haploop show` cannot display.")
    return kind
