"""Fields that a page sends: it may send anything."""

from __future__ import annotations

from ..base.errors import ConfigurationError

_LONGEST = 200
"""Bytes of a text that a page sends: what an event of a recording holds."""


def clean(text: object, what: str, least: int = 0) -> str:
    """Return a text of a page on one line. Raises ConfigurationError when it is too long or too short."""
    line = " ".join(str(text).split())
    if not least <= len(line) or len(line.encode()) > _LONGEST:
        raise ConfigurationError(f"{what} must have {least} to {_LONGEST} characters, not {len(line)}.")
    return line


def whole(value: object, what: str, least: int, most: int) -> int:
    """Read a whole number. Raises ConfigurationError."""
    try:
        number = int(str(value))
    except ValueError:
        number = least - 1
    if not least <= number <= most:
        raise ConfigurationError(
            f"{what} must be a whole number from {least} to {most}, not {str(value)[:20]!r}."
        )
    return number
