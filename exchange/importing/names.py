"""Participant and button in the names of files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...base.errors import ConfigurationError
from ..columns import read_table
from .mapping import FileMapping
from .splits import values_of

_PARTS = {"participant": r"(?P<participant>[A-Za-z]{1,4}[0-9]{1,4})", "button": r"(?P<button>[A-Za-z0-9-]+?)"}


def each_of(
    path: Path, mapping: FileMapping, column: str, say: Callable[[str], object] = lambda _: None
) -> dict[str, FileMapping]:
    """By a name for its file: the mapping of each measurement that a column of a table tells apart.

    A column of participants or buttons says who pressed what. `say` is given a sentence on rows of none.
    Raises ConfigurationError and DataError.
    """
    mapping = named(path, mapping).model_copy(update={"names": None})
    table = read_table(path, mapping.format, mapping.decimal, mapping.skip_damaged)
    found: dict[str, FileMapping] = {}
    values, without = values_of(table, column)
    if without:
        say(f"{path} has {without} rows without a value of {column}, which are of no measurement: left out.")
    names = set()
    for value in values:
        told: dict[str, Any] = {"where": {**mapping.where, column: value}}
        if column.lower() in ("participant", "button"):
            told[column.lower()] = value
        name = f"{path.stem}-{re.sub(r'[^A-Za-z0-9_.-]+', '_', value)}"
        if name.casefold() in names:  # Windows and macOS have one file of both
            raise ConfigurationError(f"{path} has two values of {column} that would be one file, {name}.h5.")
        names.add(name.casefold())
        found[name] = mapping.model_copy(update=told)
    return found


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
