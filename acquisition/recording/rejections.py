"""Presses rejected after their session: `rejections.jsonl`, in the folder of the recordings.

A finished recording is never changed, so later rejections go into a file of their own.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path

from haploop.acquisition.recording.file_format import PressVerdict
from haploop.instruments import DataError
from haploop.instruments.files import os_error_text, whole_file

__all__ = ["Rejection", "add_rejections", "without_rejected"]

_JOURNAL = "rejections.jsonl"


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
                f"{path} does not match its rejections: {path.parent / _JOURNAL} states another content "
                "hash. Restore the recording and its rejections.jsonl from the same copy."
            )
        rejected[one.number, one.attempt] = one.reason
    return tuple(
        press._replace(accepted=False, flags=(*press.flags, "rejected"), reason=f"Rejected: {rejected[key]}")
        if (key := (press.number, press.attempt)) in rejected
        else press
        for press in presses
    )


def add_rejections(folder: Path, rejections: Collection[Rejection]) -> None:
    """Add rejections of recordings in a folder, all or none. Raises DataError."""
    lines = [json.dumps(asdict(one)) + "\n" for one in (*_rejections(folder), *rejections)]
    journal = folder / _JOURNAL
    try:
        with whole_file(journal, replace=True) as part:
            part.write_text("".join(lines), encoding="utf-8")
    except OSError as error:
        raise DataError(f"{journal} cannot be written: {os_error_text(error)}.") from None


def _rejections(folder: Path) -> tuple[Rejection, ...]:
    journal = folder / _JOURNAL
    if not journal.exists():
        return ()
    try:
        lines = journal.read_text(encoding="utf-8").splitlines()
        return tuple(Rejection(**json.loads(line)) for line in lines)
    except (OSError, ValueError, TypeError):
        raise DataError(f"{journal} is damaged: restore it from a copy.") from None
