"""A frequency response of a file, as a calibration's."""

from __future__ import annotations

from pathlib import Path

from ...calibration import Response, read_uff
from ...instruments import ConfigurationError, RigFile
from .. import uff_file
from ..columns import format_of


def is_response_file(path: str | Path, format: str | None = None) -> bool:
    """True for a UFF file of frequency responses; False for signals. `format` as in a `Mapping`.

    Raises ConfigurationError for an unknown format, DataError for a damaged file.
    """
    path = Path(path)
    return format_of(path, format) == "uff" and uff_file.has_responses(path)


def import_response(
    path: str | Path, rig: RigFile, patch: str | None = None, point: str | None = None
) -> Response:
    """The response in a UFF file; of several, the one of `patch` and `point`.

    A file with one response of another name gets these names. Raises ConfigurationError for a choice that
    is not in the file, DataError for a file that cannot be read.
    """
    found = read_uff(path, rig=rig)
    wanted = [r for r in found if patch in (None, r.patch) and point in (None, r.point)]
    if len(found) == 1 and not wanted:
        wanted = list(read_uff(path, rig=rig, patch=patch, point=point))
    if len(wanted) != 1:
        places = ", ".join(f"{r.patch} at {r.point}" for r in found)
        raise ConfigurationError(
            f"{path} holds {len(wanted) or 'no'} matching responses (it has {places}): "
            "select one with --patch and --point."
        )
    return wanted[0]
