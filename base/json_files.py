"""Text files of JSON's types, which state the SHA-256 of their content; one program at a time changes one.

A file is one JSON object: the kind of file (`format`, `format_version`), the version of haploop that wrote
it (`software`), `content`, and the hash of these (`content_hash`; see `json_text`). A file is replaced
whole, so that a kill at any moment leaves the old or the new content.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from .clock import RealClock
from .errors import DataError, InstrumentError
from .files import new_file, os_error_text, whole_file
from .marks import marked

# JSON text that states the SHA-256 of its content: every JSON file and log line that haploop writes.
#
# The hash (`content_hash`) is of all other keys as canonical JSON: keys sorted, no spaces, ASCII only. So
# white space may change, and nothing else.

VERSION = 1
KEYS = {"format", "format_version", "software", "content"}
"""Keys of a file, beside its hash."""


def as_file(kind: str, content: Any) -> tuple[str, str]:
    """Text of a file of a kind, and its content hash; a list has one entry a line.

    Raises ValueError for NaN and infinity, which JSON does not have.
    """
    said = {"format": f"haploop {kind}", "format_version": VERSION, "software": f"haploop {_version()}"}
    found = content_hash({**said, "content": content})
    if isinstance(content, list):
        shown = "[\n" + ",\n".join(json.dumps(entry, allow_nan=False) for entry in content) + "\n]"
    else:
        shown = json.dumps(content, allow_nan=False, indent=1)
    head = json.dumps({**said, "content_hash": found})[:-1]
    return f'{head},\n"content": {shown}}}\n', found


def as_line(entry: Mapping[str, Any]) -> str:
    """One line of a log. Raises ValueError for NaN and infinity."""
    return json.dumps({**entry, "content_hash": content_hash(entry)}, allow_nan=False) + "\n"


def from_text(text: str | bytes) -> dict[str, Any]:
    """The object that `as_file` or `as_line` wrote, without its hash. Raises ValueError for other text."""
    return with_hash(text)[0]


def with_hash(text: str | bytes) -> tuple[dict[str, Any], str]:
    """As `from_text`, and the object's hash."""
    try:
        said = dict(json.loads(text))
        stated = said.pop("content_hash")
        if stated == content_hash(said):
            return said, stated
    except (LookupError, TypeError, RecursionError):
        pass
    raise ValueError("its content does not match its hash")


def of_file(kind: str, text: str | bytes) -> Any:
    """The content of a file of this kind and version. Raises ValueError for any other text."""
    said = from_text(text)
    if said.keys() != KEYS:
        raise ValueError("it has other keys")
    if (said["format"], said["format_version"]) != (f"haploop {kind}", VERSION):
        raise ValueError(f"it is not a haploop {kind} of version {VERSION}")
    return said["content"]


def content_hash(said: Mapping[str, Any]) -> str:
    """SHA-256 (hex) of canonical JSON. Raises ValueError for NaN and infinity."""
    text = json.dumps(said, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def _version() -> str:
    return metadata.version("haploop")


_LARGEST = 1 << 28
"""Bytes of a file that are read; a list of 10^5 entries has a tenth of it."""
_PATIENCE = 10.0
"""Seconds that a program waits for another one's change, which takes milliseconds."""


def write_json(path: Path, kind: str, content: Any) -> str:
    """Write a new file of a kind, whole or not at all; return its content hash. Raises DataError."""
    text, content_hash = _text(path, kind, content)
    with new_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return content_hash


def append_json(path: Path, kind: str, entries: Sequence[Mapping[str, Any]]) -> None:
    """Append entries to a file that holds a list, all or none; file and folder are made when there is none.

    Several programs may do so at the same time. Raises DataError.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"{path} cannot be written: {os_error_text(error)}.") from None
    with changing(path):
        before = read_json(path, kind, list) if path.exists() else []
        text, _ = _text(path, kind, [*before, *entries])
        try:
            with whole_file(path, replace=True) as part:
                part.write_text(text, encoding="utf-8", newline="\n")
        except OSError as error:
            raise DataError(f"{path} cannot be written: {os_error_text(error)}.") from None


def read_json(path: Path, kind: str, holds: type) -> Any:
    """Read the content, of the type `holds`. Raises DataError for a missing, other or damaged file."""
    said = _read(path)
    if said["format"] != f"haploop {kind}":
        raise DataError(f"{path} is not a haploop {kind}: it says {str(said['format'])[:60]!r}.")
    if not isinstance(said["content"], holds):
        raise DataError(f"{path} holds no {kind}: it was not written by this version of haploop.")
    return said["content"]


def json_hash(path: Path) -> str:
    """Content hash of a file of any kind, verified. Raises DataError."""
    return content_hash(_read(path))


def is_json(path: Path) -> bool:
    """True for a file that begins as `write_json` writes it; it may still be damaged."""
    try:
        with path.open("rb") as file:
            return file.read(12) == b'{"format": "'
    except OSError:
        return False


@contextmanager
def changing(path: Path) -> Iterator[None]:
    """Keep other programs from changing a file, or what is in a folder, for a moment: they wait.

    Raises DataError when another program does not end its change within 10 s, or the folder cannot be
    written.
    """
    clock = RealClock()
    deadline = clock.now() + _PATIENCE
    with ExitStack() as stack:
        while True:
            try:
                stack.enter_context(marked(path))
                break
            except InstrumentError:
                busy = f"{path} is being changed by another program: try again."
            except OSError as error:
                busy = f"{path} cannot be written: {os_error_text(error)}."
                # Windows refuses for an instant to open a file that another program removes.
                if os.name != "nt" or not isinstance(error, PermissionError):
                    raise DataError(busy) from None
            if clock.now() > deadline:
                raise DataError(busy)
            clock.sleep(0.005)
        yield


def _text(path: Path, kind: str, content: Any) -> tuple[str, str]:
    try:
        return as_file(kind, content)
    except ValueError:
        raise DataError(f"{path} was not written: a value is NaN or infinite. Measure again.") from None


def _read(path: Path) -> dict[str, Any]:
    """Read a file's object, verified. Raises DataError."""
    try:
        with path.open("rb") as file:
            raw = file.read(_LARGEST + 1)
    except FileNotFoundError:
        raise DataError(f"There is no file {path}: check the name.") from None
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_error_text(error)}.") from None
    try:
        said = from_text(raw if len(raw) <= _LARGEST else b"")
        if said.keys() != KEYS:
            raise ValueError("keys")
    except ValueError:
        raise DataError(f"{path} is damaged or was changed by hand: restore it from a copy.") from None
    if said["format_version"] != VERSION:
        raise DataError(
            f"{path} has format {str(said['format_version'])[:20]} and this version reads {VERSION}: it was "
            f"written by {str(said['software'])[:60]}."
        )
    return said
