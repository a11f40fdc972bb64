"""What a source does not say, as a question with its option."""

from __future__ import annotations

from dataclasses import dataclass

from .mapping import Role


@dataclass(frozen=True)
class Question:
    """Something that the file does not say."""

    key: Role | str
    """What is asked for: a role, "rate", or "unit ROLE", "flip ROLE", "rest ROLE", "where COLUMN"."""
    what: str
    """For a sentence: "the unit of force (column 1, F)"."""
    option: str
    """How it is told: "--unit force=N"."""
