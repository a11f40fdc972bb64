"""The progress of a long step: one shape of callback, whatever shows it."""

from __future__ import annotations

from typing import Protocol

__all__ = ["Progress", "part_of", "prefixed", "silent"]


class Progress(Protocol):
    """A callback that a long step calls at its start, on its way, and at its end.

    It is called from the thread that measures: it must return soon, and what it raises ends the step.
    """

    def __call__(self, doing: str, done: float, total: float, unit: str, /) -> object:
        """Receive that `done` of `total` are done, both in `unit` ("s", "presses"; "" for one whole step).

        `doing` says what is being done, in one line, and stays the same throughout a step.
        """


def silent(doing: str, done: float, total: float, unit: str, /) -> None:
    """Do nothing: the default progress callback."""


def prefixed(progress: Progress, prefix: str) -> Progress:
    """A callback for a step within a larger one: it says `prefix`, a colon, and what the step is doing."""
    return lambda doing, done, total, unit: progress(f"{prefix}: {doing}", done, total, unit)


def part_of(progress: Progress, doing: str, before: float, total: float) -> Progress:
    """A callback for a part of a step, with `before` of the step's `total` done when the part begins."""
    return lambda _part, done, _of, unit: progress(doing, min(before + done, total), total, unit)
