"""The operator role without a person: at night, under a scheduler."""

from __future__ import annotations

from .role import Aim, ConfirmSettings, Operator, Request, Rest


class Unattended(Operator):
    """Answers at once, on the assumption that nothing was moved since the person left.

    The laser is still aimed at `aimed_at`, settings are as declared, and hands are off; a request
    that needs a person is refused. `assumed` holds the confirmed requests, as sentences.
    """

    def __init__(self, aimed_at: str = "button") -> None:
        self.aimed_at = aimed_at
        self.assumed: dict[str, None] = {}

    def tell(self, request: Request) -> None:
        """Do nothing (see `Operator.tell`)."""

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
