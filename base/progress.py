"""Progress callbacks of long steps: one signature for every display."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Callback that a long step calls at its start, during it and at its end.

    It is called from the measuring thread: it must return quickly, and an exception in it ends the step.
    """

    def __call__(self, doing: str, done: float, total: float, unit: str, /) -> object:
        """Report that `done` of `total` are done, both in `unit` ("s", "presses"; "" for one whole step).

        `doing` describes the step in one line, and stays the same throughout it.
        """


def silent(doing: str, done: float, total: float, unit: str, /) -> None:
    """Do nothing: the default progress callback."""


def prefixed(progress: Progress, prefix: str) -> Progress:
    """Return a callback for a step within a larger one; it puts `prefix` and a colon before `doing`."""
    return lambda doing, done, total, unit: progress(f"{prefix}: {doing}", done, total, unit)


def part_of(progress: Progress, doing: str, before: float, total: float) -> Progress:
    """Return a callback for a part of a step; `before` of the step's `total` is done when it begins."""
    return lambda _part, done, _of, unit: progress(doing, min(before + done, total), total, unit)
