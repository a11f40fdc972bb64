"""The operator when nobody is there: at night, for a scheduler."""

from __future__ import annotations

from haploop.instruments.operator.role import Aim, ConfirmSettings, Operator, Request, Rest

__all__ = ["Unattended"]


class Unattended(Operator):
    """Answers at once for the person who left: nothing was moved since, and nothing can be moved now.

    The laser is still aimed at `aimed_at`, settings are as they were declared, hands are off;
    whatever needs a hand is refused. `assumed` holds what was confirmed in that manner, as sentences.
    """

    def __init__(self, aimed_at: str = "button") -> None:
        self.aimed_at = aimed_at
        self.assumed: dict[str, None] = {}

    def tell(self, request: Request) -> None:
        """See `Operator.tell`. There is nobody to tell."""

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`."""
        match request:
            case Aim():
                there = request.point == self.aimed_at
            case ConfirmSettings() | Rest():
                there = True
            case _:
                there = False
        if there:
            self.assumed[str(request)] = None
        return there
