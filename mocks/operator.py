"""The operator's twin: does to the plant what a person would do at the rig."""

from __future__ import annotations

from pydantic import BaseModel

from instruments.operator import Aim, Operator, Press, Request
from mocks.plant import Plant

__all__ = ["OperatorTwin"]


class OperatorTwin(Operator):
    """Presses when told to, aims where told to, and has set every instrument as the rig file says."""

    def __init__(self, settings: BaseModel, plant: Plant) -> None:
        self._plant = plant

    def tell(self, request: Request) -> None:
        """See `Operator.tell`."""
        if isinstance(request, Press):
            self._plant.press(request)

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`."""
        if isinstance(request, Aim):
            self._plant.aim(request.point)
        return True
