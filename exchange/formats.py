"""What can be exported into what: one table of (kind of file, format) -> function.

To add a format, copy the smallest module (`uff_file`), write a view of `views` in it, and enter the
function in `FORMATS`. A function gets the path of the file to export and the path to write.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

from ..acquisition import load_study
from ..base import hdf5
from ..base.errors import ConfigurationError, DataError
from ..base.files import check_destination, private_files, reserved
from ..calibration import Calibration
from . import csv_file, haptic_files, mat_file, reading, uff_file, wav_file, xdf_file
from .views import About, Envelope, PressTable, Responses, Signals, sidecar, write_json

View = TypeVar("View", Signals, Responses, PressTable, Envelope)
Export = Callable[[Path, Path], About]


def _via(read: Callable[[Path], View], write: Callable[[View, Path], None]) -> Export:
    def export(path: Path, out: Path) -> About:
        view = read(path)
        write(view, out)
        return view.about

    return export


def _curve(path: Path, out: Path) -> About:
    table = reading.curve_rows(path)
    write_json(sidecar(out), {"title": table.title, "units": dict(table.units), "about": dict(table.about)})
    csv_file.write_presses(table, out)
    return table.about


def _model(path: Path, out: Path) -> About:
    calibration, view = Calibration.load(path), reading.calibration_responses(path)
    mat_file.write_responses(view, out, calibration.model.variables(calibration.rate_hz))
    return view.about


_SIGNALS = {
    "csv": csv_file.write_signals,
    "wav": wav_file.write_float,
    "wav48": wav_file.write_sound_card,
    "mat": mat_file.write_signals,
    "uff": uff_file.write_signals,
}
_RESPONSES = {
    "csv": csv_file.write_responses,
    "mat": mat_file.write_responses,
    "uff": uff_file.write_responses,
}
_HAPTIC = {
    "ahap": haptic_files.write_ahap,
    "haptic": haptic_files.write_meta,
    "android": haptic_files.write_android,
    "hjif": haptic_files.write_hjif,
}


def _table() -> dict[tuple[str, str], Export]:
    table: dict[tuple[str, str], Export] = {}
    for kind, signals, envelope in (
        ("recording", reading.recording_signals, None),
        ("representative", reading.representative_signals, reading.envelope_of_representative),
        ("drive", reading.drive_signals, reading.envelope_of_drive),
        ("check", reading.check_signals, reading.envelope_of_check),
        ("button", reading.button_signals, reading.envelope_of_button),
    ):
        table |= {(kind, name): _via(signals, write) for name, write in _SIGNALS.items()}
        if envelope is not None:
            table |= {(kind, name): _via(envelope, write) for name, write in _HAPTIC.items()}
    for kind, responses in (("calibration", reading.calibration_responses), ("map", reading.map_responses)):
        table |= {(kind, name): _via(responses, write) for name, write in _RESPONSES.items()}
    table["study", "csv"] = _via(lambda path: reading.study_presses(load_study(path)), csv_file.write_presses)
    table["curve", "csv"] = _curve
    table["recording", "xdf"] = xdf_file.write_recording
    # Of a calibration MATLAB gets the model too, which simulates.
    table["calibration", "mat"] = _model
    return table


FORMATS: Mapping[tuple[str, str], Export] = _table()
"""(kind, format) -> function(path, out), which writes the new file `out`."""
_BESIDE = {(kind, name) for kind, name in FORMATS if name in ("csv", "wav", "wav48") and kind != "study"}
"""Exports with a sidecar; each row of a study's table says itself what it comes from."""


@dataclass(frozen=True)
class Exported:
    """What `export_file` wrote: the kind of the source, and the new files, the main one first."""

    kind: str
    format: str
    files: tuple[Path, ...]
    simulated: bool


def export_file(
    files: str | Path | Sequence[str | Path],
    format: str,
    out: str | Path,
    *,
    of: Literal["table", "press"] = "table",
) -> Exported:
    """Export a file that haploop wrote, as a new file `out` of another format.

    `files` is one file, the folder of a vibration map, a study (its study.toml or its folder), or several
    recordings; a study and several recordings become a table with one row a press. `FORMATS` lists the
    formats of each kind. A format without room for units or origin gets a sidecar, `OUT.json`. For a phone a
    digital button is what the table is to play, or `of` the recorded "press", which is far stronger.

    Raises ConfigurationError for a format that does not fit, a package that is not installed, or an `out`
    that exists, and DataError for a file that cannot be read. Of recordings, studies and representative
    presses the new files are readable by their owner only.

    For example:

        >>> done = haploop.export_file("press.h5", "csv", "press.csv")
        >>> [path.name for path in done.files]
        ['press.csv', 'press.csv.json']
    """
    paths = [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
    out = Path(out)
    kind = _kind_of(paths)
    offered = sorted(name for own, name in FORMATS if own == kind)
    if format not in offered:
        raise ConfigurationError(
            f"{'A ' + kind if len(paths) == 1 else 'Several recordings'} cannot be exported as {format!r}: "
            f"choose {', '.join(offered)}."
            + (
                " Make a representative press of it first."
                if kind == "recording" and format in _HAPTIC
                else ""
            )
        )
    if of == "press" and not (kind == "button" and format in _HAPTIC):
        raise ConfigurationError(
            "The recorded press is taken of a digital button, for a phone: leave --of press out, or export "
            "its representative press."
        )
    # What people pressed is for its owner alone, as its source is.
    private = of == "press" or kind in ("recording", "study", "representative")
    with private_files() if private else nullcontext():
        check_destination(out)
        written = (out, sidecar(out)) if (kind, format) in _BESIDE else (out,)
        with reserved(*written, size=1):  # how large they become is not known before
            if len(paths) > 1:
                table = reading.recording_presses(paths)
                csv_file.write_presses(table, out)
                about = table.about
            elif of == "press":
                about = _via(reading.envelope_of_press, _HAPTIC[format])(paths[0], out)
            else:
                about = FORMATS[kind, format](paths[0], out)
    return Exported(kind, format, written, bool(about["simulated"]))


def _kind_of(paths: Sequence[Path]) -> str:
    """Kind of one file; "study" for several recordings. Raises ConfigurationError and DataError."""
    if not paths:
        raise ConfigurationError("There is no file to export: name one.")
    if len(paths) > 1:
        for path in paths:
            if hdf5.kind_of(path) != "recording":
                raise ConfigurationError(f"{path} is no recording: export other files one at a time.")
        return "study"
    path = paths[0]
    if (path / "map.json").is_file():
        return "map"
    if path.is_dir() or path.suffix == ".toml":
        return "study"
    kind = hdf5.kind_of(path)
    if not any(own == kind for own, _ in FORMATS):
        raise DataError(f"{path} holds a {kind}, which `haploop export` does not know.")
    return kind
