"""How presses are asked for, and which of them are accepted."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Self

from haploop.acquisition.presses.segmentation import Segmentation
from haploop.instruments import DataError

__all__ = ["Protocol"]


@dataclass(frozen=True)
class Protocol:
    """How presses are asked for and accepted. Times in s of the stream, not of the wall clock."""

    block: float = 0.05
    rest: float = 0.5
    """Hands off, at the beginning: the sensors' rest is measured."""
    rest_spread: float = 0.15
    """N. More force than this, up and down within `rest`, is not hands off (noise: 0.03 N)."""
    patience: float = 15.0
    """How long to wait for hands off, for a press to begin, and for it to end."""
    wait: float = 0.0
    """How long a session waits beyond `patience`, in all, for hands off and for presses to begin."""
    quiet: float = 0.3
    """Time without force before a press counts as over and the next is asked for."""
    trail: float = 0.5
    """Recorded after the last press."""
    attempts: int = 5
    """Attempts at one press within a session before the session ends."""
    force: tuple[float, float] | None = None
    """N, lowest and highest at activation. Without it: from where a press begins to 80 % of the sensor's
    rating, which no press may exceed anyway."""
    before: float = 0.2
    """Time without force before the finger arrives."""
    light: float = 1.0
    """N. A force below this, and below 30 % of the press's largest, is a finger that rests on the button."""
    linger: float = 0.2
    """Longest time that the finger may rest there, before and after; in a clean press it is below 0.05 s."""
    segmentation: Segmentation = field(default_factory=Segmentation)

    def to_json(self) -> str:
        """As a recording keeps it."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> Self | None:
        """What `to_json` wrote; None for a recording without verdicts (`{}`).

        Raises DataError for a protocol that this version cannot read.
        """
        try:
            values = json.loads(text)
            if not values:
                return None
            values["segmentation"] = Segmentation(**values["segmentation"])
            values["force"] = values["force"] and tuple(values["force"])
            return cls(**values)
        except (ValueError, TypeError, KeyError):
            raise DataError(
                "The recording's protocol was written by a newer haploop: update haploop to read it."
            ) from None
