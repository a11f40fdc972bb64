"""The simulated person at the rig."""

from __future__ import annotations

from pydantic import BaseModel

from ..instruments.operator import (
    Aim,
    Cable,
    ConfirmSettings,
    LiftFinger,
    Operator,
    Place,
    Press,
    Remove,
    Request,
    RestFinger,
    TakeTarget,
    Target,
    Touch,
    Uncable,
)
from .plant import Plant

# The operator's twin, which acts on the plant as a person acts on the rig.


class OperatorTwin(Operator):
    """Simulated operator: follows every request, and confirms the instruments' settings truthfully."""

    def __init__(self, settings: BaseModel, plant: Plant) -> None:
        self._plant = plant

    def tell(self, request: Request) -> None:
        """See `Operator.tell`."""
        self.confirm(request)

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`."""
        if isinstance(request, ConfirmSettings):
            return self._plant.set_as_filed
        self._follow(request)
        return True

    def _follow(self, request: Request) -> None:
        match request:
            case Press():
                self._plant.press(request)
            case Touch():
                self._plant.touch(request)
            case RestFinger():
                self._plant.rest(request)
            case LiftFinger():
                self._plant.lift()
            case Aim():
                self._plant.aim(request.point)
            case Place():
                self._plant.put(request.mass)
            case Remove():
                self._plant.put(0.0)
            case Target():
                self._plant.target = request.area
            case TakeTarget():
                self._plant.target = 0.0
            case Cable():
                self._plant.cables[request.channel] = request.output
            case Uncable():
                self._plant.cables.clear()
