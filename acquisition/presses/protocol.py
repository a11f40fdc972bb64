"""The protocol of a recording: timing of the prompts, and acceptance limits of a press."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Self

from ...base.errors import DataError
from .segmentation_settings import Segmentation


@dataclass(frozen=True)
class Protocol:
    """Timing of the prompts and acceptance limits. Times in s of the stream, not of the wall clock."""

    block: float = 0.05
    """Length of a block."""
    rest: float = 0.5
    """Duration of hands off at the beginning, in which the sensors' rest is measured."""
    rest_spread: float = 0.15
    """N: largest peak-to-peak force within `rest` that counts as hands off (noise: 0.03 N)."""
    patience: float = 15.0
    """Longest wait for hands off, for a press to begin, and for it to end."""
    wait: float = 0.0
    """Total extra wait of a session, beyond `patience`, for hands off and for presses to begin."""
    pause: float = 0.0
    """Total time for which the operator may pause a session; it counts as no waiting."""
    quiet: float = 0.3
    """Time without force before a press counts as over and the next is asked for."""
    trail: float = 0.5
    """Recorded after the last press."""
    attempts: int = 5
    """Attempts at one press within a session before the session ends."""
    force: tuple[float, float] | None = None
    """N, lowest and highest at activation. Default: from `Segmentation.pressed` to 80 % of the sensor's
    rating, the limit of every press."""
    before: float = 0.2
    """Time without force before the finger arrives."""
    light: float = 1.0
    """N. A force below this, and below 30 % of the press's largest, is a finger that rests on the button."""
    linger: float = 0.2
    """Longest time of resting before and after a press; below 0.05 s in a clean press."""
    segmentation: Segmentation = field(default_factory=Segmentation)

    def to_json(self) -> str:
        """JSON text stored in a recording."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> Self | None:
        """Read the text of `to_json`; None for a recording without verdicts (`{}`).

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
