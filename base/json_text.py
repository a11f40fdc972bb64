"""JSON text that states the SHA-256 of its content: every JSON file and log line that haploop writes.

The hash (`content_hash`) is of all other keys as canonical JSON: keys sorted, no spaces, ASCII only. So
white space may change, and nothing else.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from typing import Any

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
