"""What the limits of a play rest on: noted when a rig is opened, and compared before each play.

What is open is frozen, but Python lets a notebook write past that (`vars(rig.file.limits).update(...)`,
another method in place of an instrument's own). A play is held to the copy that was made at opening.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass

from ...base.errors import LimitError
from ..limits import Limits


@dataclass(frozen=True)
class Figures:
    """All figures of one moment."""

    ratings: Mapping[int, Mapping[str, Limits]]
    """By number of patches in parallel, and owner."""
    at_input: tuple[float, ...]
    """Volts at the amplifier's input for some volts at the patch."""
    digest: str
    """Of the rig file."""


class Kept:
    """The figures of a rig when it was opened."""

    def __init__(self) -> None:
        self._own: Figures | None = None

    def note(self, figures: Figures) -> None:
        """Keep a copy of these."""
        self._own = deepcopy(figures)

    def of_one(self) -> Mapping[str, Limits]:
        """The ratings kept for one patch; none before the rig is open."""
        return {} if self._own is None else self._own.ratings.get(1, {})

    def ratings(self, patches: int, now: Figures) -> Mapping[str, Limits]:
        """The ratings kept for so many patches in parallel.

        Raises LimitError when any figure is another one now.
        """
        own = self._own
        if own is None:
            raise LimitError("Nothing is played before the rig is open.")
        if own != now:
            named = ("limit", own.ratings, now.ratings), ("amplifier's gain", own.at_input, now.at_input)
            what = next((name for name, before, after in named if before != after), "rig file")
            raise LimitError(
                f"Nothing is played: the {what} of the open rig is not what it was at opening. Change the "
                "rig file, not the program's copy of it, and open the rig again."
            )
        # More patches than there are will be refused by the relay.
        return own.ratings.get(patches, own.ratings[max(own.ratings)])
