"""The operator role: what only a person can do, asked for in values that a person's twin can read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

__all__ = ["Aim", "ConfirmSettings", "Operator", "Place", "Press", "Remove", "Request", "Rest"]


@dataclass(frozen=True)
class Press:
    """Press a button once: press `number` of `of`."""

    button: str
    participant: str
    number: int
    of: int

    def __str__(self) -> str:
        return f"Press the {self.button} button ({self.number} of {self.of})."


@dataclass(frozen=True)
class Rest:
    """Keep hands off for `duration` seconds: the sensors' rest is being measured."""

    duration: float

    def __str__(self) -> str:
        return f"Hands off for {self.duration:g} s: the sensors' rest is being measured."


@dataclass(frozen=True)
class Aim:
    """Aim the laser at a point of the table ("button", or the number of a grid point)."""

    point: str

    def __str__(self) -> str:
        where = "the button point" if self.point == "button" else f"point {self.point}"
        return f"Aim the laser at {where}."


@dataclass(frozen=True)
class ConfirmSettings:
    """Check settings that no software can read."""

    sentence: str

    def __str__(self) -> str:
        return self.sentence


@dataclass(frozen=True)
class Place:
    """Put a known mass (kg) on the force sensor, where the button stands."""

    mass: float

    def __str__(self) -> str:
        return f"Place a mass of {self.mass:g} kg on the force sensor, in its middle, and let go."


@dataclass(frozen=True)
class Remove:
    """Take away what `Place` asked for."""

    def __str__(self) -> str:
        return "Take the mass off the force sensor."


Request = Press | Rest | Aim | ConfirmSettings | Place | Remove


class Operator(ABC):
    """The person at the rig."""

    @abstractmethod
    def tell(self, request: Request) -> None:
        """Say what is to be done now, and return at once: what follows is measured meanwhile."""

    @abstractmethod
    def confirm(self, request: Request) -> bool:
        """Ask, and wait for the answer: True when it is done or so."""
