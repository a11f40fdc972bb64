"""How presses are asked for, and what of them is accepted."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Self

from acquisition.presses import Segmentation
from instruments import DataError

__all__ = ["Protocol"]


@dataclass(frozen=True)
class Protocol:
    """How presses are asked for and judged. Times in s of the stream, never of the wall."""

    block: float = 0.05
    rest: float = 0.5
    """Hands off, at the beginning: the sensors' rest is measured."""
    rest_spread: float = 0.15
    """N. More force than this, up and down within `rest`, is not hands off (noise: 0.03 N)."""
    patience: float = 15.0
    """How long to wait for hands off, for a press to begin, and for it to end."""
    quiet: float = 0.3
    """Without force, before a press counts as over and the next is asked for."""
    trail: float = 0.5
    """Recorded after the last press."""
    attempts: int = 5
    """How often one press is asked for in one sitting until it is a good one."""
    force: tuple[float, float] | None = None
    """N, lowest and highest at activation. Without it: from where a press begins to 80 % of the sensor's
    rating, which no press may exceed anyway."""
    before: float = 0.2
    """Without force, before the finger comes."""
    light: float = 1.0
    """N. Less than this, and less than 30 % of the press's largest force, is a finger that lies there."""
    linger: float = 0.2
    """How long it may lie there, before and after: in a clean press, less than 0.05 s."""
    segmentation: Segmentation = field(default_factory=Segmentation)

    def to_json(self) -> str:
        """As a recording keeps it."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> Self | None:
        """What `to_json` wrote; None for a recording that was made without judging (`{}`).

        Raises DataError for what this haploop does not understand.
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
                "A recording's protocol is one that this haploop does not understand: update it."
            ) from None
