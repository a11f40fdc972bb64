"""Presses rejected after their session: `rejections.json`, in the folder of the recordings.

A finished recording is never changed, so later rejections go into a file of their own.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path

from ...base.errors import DataError
from ...base.files import private_files
from ...base.json_files import append_json, read_json
from .rows import PressVerdict

_FILE, _KIND = "rejections.json", "rejections"


@dataclass(frozen=True)
class Rejection:
    """A press that was rejected after its session."""

    file: str
    """Name of the recording in the same folder."""
    sha256: str
    """Its content hash."""
    number: int
    attempt: int
    reason: str
    time: str
    """ISO 8601."""


def without_rejected(
    path: Path, content_hash: str, presses: Collection[PressVerdict]
) -> tuple[PressVerdict, ...]:
    """Apply later rejections to the verdicts of a recording. Raises DataError."""
    rejected = {}
    for one in _rejections(path.parent):
        if one.file != path.name:
            continue
        if one.sha256 != content_hash:
            raise DataError(
                f"{path} does not match its rejections: {path.parent / _FILE} states another content "
                f"hash. Restore the recording and its {_FILE} from the same copy."
            )
        rejected[one.number, one.attempt] = one.reason
    return tuple(
        press._replace(accepted=False, flags=(*press.flags, "rejected"), reason=f"Rejected: {rejected[key]}")
        if (key := (press.number, press.attempt)) in rejected
        else press
        for press in presses
    )


def add_rejections(folder: Path, rejections: Collection[Rejection]) -> None:
    """Add rejections of recordings in a folder, all or none; several programs may. Raises DataError."""
    with private_files():
        append_json(folder / _FILE, _KIND, [asdict(one) for one in rejections])


def _rejections(folder: Path) -> tuple[Rejection, ...]:
    path = folder / _FILE
    if not path.exists():
        return ()
    try:
        return tuple(Rejection(**entry) for entry in read_json(path, _KIND, list))
    except TypeError:
        raise DataError(f"{path} holds something else than rejections: restore it from a copy.") from None
