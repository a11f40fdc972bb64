"""A kind of job, what it needs beside the rig, and how its parameters are read: a page may send anything."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.errors import ConfigurationError
from ...base.threads import Flag
from ...instruments import Rig, RigFile
from ..data_folder import DataFolder
from .board import Board
from .presenting import Stimuli

Work = Callable[[Rig], dict[str, Any]]
_MOST_POINTS = 9999
"""Largest number of a grid point that is looked for: a typing error must not fill the memory."""


@dataclass(frozen=True)
class Tools:
    """What a job needs beside the rig."""

    board: Board
    data: DataFolder
    file: RigFile
    stimuli: Stimuli
    looking: Flag
    """Set while the sensors are looked at, and cleared to end that."""


@dataclass(frozen=True)
class Job:
    """A kind of job: `prepare` checks the parameters; `gated` ones need a preflight first."""

    prepare: Callable[[Tools, Mapping[str, Any]], Work]
    title: Callable[[Mapping[str, Any]], str]
    gated: bool = False
    needs_rig: bool = True


def numbers(text: str) -> list[int] | None:
    """Read grid points such as "0, 5, 12-20"; None for all. Raises ConfigurationError."""
    found: list[int] = []
    for part in filter(None, (part.strip() for part in text.split(","))):
        first, _, last = part.partition("-")
        if not (first.isdecimal() and (last or first).isdecimal() and len(part) < 12):
            raise ConfigurationError(f"Points are numbers such as 0, 5, 12-20; {part[:20]!r} is none.")
        begin, end = int(first), int(last or first)
        if not begin <= end <= _MOST_POINTS:
            raise ConfigurationError(
                f"Points go from a smaller number to a larger one, {_MOST_POINTS} at most; {part[:20]!r} "
                "does not."
            )
        found += range(begin, end + 1)
    return found or None


def number(value: object, what: str, unit: str) -> float | None:
    """Read a number; None where a field is empty. Raises ConfigurationError."""
    text = "" if value is None else str(value).strip()
    if not text:
        return None
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise ConfigurationError(f"{what} must be a number of {unit}, such as 5, not {text[:20]!r}.")
    return found


def words(value: object) -> list[str]:
    """Read names with commas or spaces between them, each once."""
    return list(dict.fromkeys(str(value or "").replace(",", " ").split()))


def files(data: DataFolder, names: object) -> list[Path]:
    """The paths of files that were chosen from a list. Raises ConfigurationError."""
    if not isinstance(names, Sequence) or isinstance(names, str):
        return []
    return [data.path(name) for name in names]
