"""A file that is understood becomes a recording, a press, a curve, or a calibration's response."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

from ...base import hdf5
from ...base.errors import ConfigurationError, DataError
from ...base.files import make_folder, os_error_text, private_files
from ...calibration import Response, read_uff
from ...instruments import RigFile
from .. import uff_file
from ..columns import format_of, has_responses, read_responses
from ..views import read_sidecar
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
        >>> haploop.import_file(haploop.exchange.understand("theirs.csv"), "mine.h5")
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


# A frequency response of a file, as a calibration's.


def is_response_file(path: str | Path, format: str | None = None) -> bool:
    """True for a file of frequency responses; False for signals. `format` as in a `FileMapping`.

    Raises ConfigurationError for an unknown format, DataError for a damaged file.
    """
    path = Path(path)
    found = format_of(path, format)
    with suppress(DataError):  # a file of haploop's own needs no import
        return not hdf5.kind_of(path)
    if found == "csv":
        return "responses" in read_sidecar(path)
    if found in ("mat", "hdf5", "numpy", "netcdf") and path.is_file():
        return has_responses(path)
    return found == "uff" and uff_file.has_responses(path)


def import_response(
    path: str | Path,
    rig: RigFile,
    patch: str | None = None,
    point: str | None = None,
    unit: str | None = None,
) -> Response:
    """The response in a UFF, MATLAB, HDF5, NumPy or netCDF file, or in a CSV file that haploop exported.

    Of several, it is the one of `patch` and `point`.

    `unit`, "(mm/s)/V" say, is what it is in where the file does not say. A file with one response of another
    name gets these names. Raises ConfigurationError for a choice that is not in the file, DataError for a
    file that cannot be read.
    """
    path = Path(path)
    found = read_uff(path, rig=rig) if format_of(path, None) == "uff" else read_responses(path, unit)
    wanted = [r for r in found if patch in (None, r.patch) and point in (None, r.point)]
    if len(found) == 1 and not wanted:
        wanted = [replace(found[0], patch=patch or found[0].patch, point=point or found[0].point)]
    if len(wanted) != 1:
        places = ", ".join(f"{r.patch} at {r.point}" for r in found)
        raise ConfigurationError(
            f"{path} holds {len(wanted) or 'no'} matching responses (it has {places}): "
            "select one with --patch and --point."
        )
    source = f"imported from {path.name}, sha256 {hashlib.sha256(path.read_bytes()).hexdigest()}"
    return replace(wanted[0], source=source, rig=rig.name, rig_file=rig.model_dump_json())
