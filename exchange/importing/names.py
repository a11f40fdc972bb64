"""Participant and button in the names of files."""

from __future__ import annotations

import re
from pathlib import Path

from ...instruments import ConfigurationError
from .mapping import FileMapping

_PARTS = {"participant": r"(?P<participant>[A-Za-z]{1,4}[0-9]{1,4})", "button": r"(?P<button>[A-Za-z0-9-]+?)"}


def named(path: Path, mapping: FileMapping) -> FileMapping:
    """The mapping with what a file's name says by its pattern `names`. Raises ConfigurationError."""
    if mapping.names is None:
        return mapping
    pattern = re.escape(mapping.names).replace(r"\*", ".*?")
    for part, regex in _PARTS.items():
        pattern = pattern.replace(rf"\{{{part}\}}", regex, 1)
    match = re.fullmatch(pattern, path.stem)
    if match is None:
        raise ConfigurationError(
            f"{path.name} is not named as {mapping.names!r}: name it so, or leave the names out and state "
            "--participant and --button."
        )
    return mapping.model_copy(update=match.groupdict())
