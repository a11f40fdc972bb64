"""A frequency response of a file, as a calibration's."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ...base import hdf5
from ...base.errors import ConfigurationError, DataError
from ...calibration import Response, read_uff
from ...instruments import RigFile
from .. import uff_file
from ..columns import format_of, has_responses, read_responses
from ..views import read_sidecar


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
