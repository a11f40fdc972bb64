"""The operator role: requests to a person, as values that a simulated person can read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from ...base.errors import InstrumentError


@dataclass(frozen=True)
class Press:
    """Press a button once: press `number` of `of`, for the `attempt`-th time."""

    button: str
    participant: str
    number: int
    of: int
    attempt: int = 1
    because: str = ""
    """Reason for the repetition."""
    words: str = ""
    """Prompt that replaces this class's own."""
    patience: float = field(default=0.0, compare=False)
    """s: after this the request is repeated, and the session waits."""
    wait: float = field(default=0.0, compare=False)
    """s: how long it waits then, before it ends."""

    def __str__(self) -> str:
        again = " again" if self.attempt > 1 else ""
        words = self.words or f"Press the {self.button} button{again} ({self.number} of {self.of})."
        return f"{self.because} {words}" if self.because else words


@dataclass(frozen=True)
class Rest:
    """Keep hands off for `duration` seconds: the sensors' rest is being measured."""

    duration: float

    def __str__(self) -> str:
        return f"Hands off for {self.duration:g} s: the sensors' rest is being measured."


@dataclass(frozen=True)
class Consent:
    """Ask whether a participant has consented to being recorded."""

    participant: str
    words: str = ""
    """Prompt that replaces the default, as in `Press`."""

    def __str__(self) -> str:
        return self.words or f"Has {self.participant} read and signed the consent form?"


@dataclass(frozen=True)
class Ready:
    """Ask whether a participant sits at a button and can begin."""

    participant: str
    button: str
    presses: int
    words: str = ""
    """Prompt that replaces the default, as in `Press`."""

    def __str__(self) -> str:
        return self.words or (
            f"{self.participant} at the {self.button} button, presses to come: {self.presses}. Ready?"
        )


@dataclass(frozen=True)
class Aim:
    """Aim the laser at a point of the table ("button", or the number of a grid point)."""

    point: str
    glued: str = ""
    """Name of a pick-up that is glued to the table there, in place of a laser."""

    def __str__(self) -> str:
        where = "the button point" if self.point == "button" else f"point {self.point}"
        return f"Glue the {self.glued} to {where}." if self.glued else f"Aim the laser at {where}."


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
    """Take the mass of `Place` off the force sensor."""

    def __str__(self) -> str:
        return "Take the mass off the force sensor."


@dataclass(frozen=True)
class Cable:
    """Unplug the amplifier's input, and connect an output of the DAQ to one of its channels instead."""

    output: str
    channel: str

    def __str__(self) -> str:
        return (
            f"Switch the amplifier off and unplug its input. Then connect the output {self.output} to the "
            f"input {self.channel} by a cable."
        )


@dataclass(frozen=True)
class Uncable:
    """Take the cable of `Cable` away, and plug the amplifier's input in again."""

    output: str

    def __str__(self) -> str:
        return f"Take the cable away, and connect the output {self.output} to the amplifier's input again."


@dataclass(frozen=True)
class Touch:
    """Press the touch surface once, with the finger that the camera sees: touch `number` of `of`."""

    participant: str
    pressure: Literal["light", "firm", "as a button"]
    number: int
    of: int

    def __str__(self) -> str:
        how = {"light": "lightly", "firm": "firmly", "as a button": "as you would press a button"}
        return f"Press the touch surface {how[self.pressure]}, and lift ({self.number} of {self.of})."


@dataclass(frozen=True)
class Target:
    """Put a target of known `area` (m^2) on the touch surface, where the camera sees it, and nothing else."""

    area: float

    def __str__(self) -> str:
        return f"Put the target of {1e6 * self.area:g} mm² on the touch surface, and take your hands off."


@dataclass(frozen=True)
class TakeTarget:
    """Take everything off the touch surface."""

    def __str__(self) -> str:
        return "Take everything off the touch surface: target and hands."


@dataclass(frozen=True)
class RestFinger:
    """Rest a fingertip on the table at a point, with a force (N), and hold it until `LiftFinger`."""

    participant: str
    point: str
    force: float

    def __str__(self) -> str:
        where = "the button point" if self.point == "button" else f"point {self.point}"
        return (
            f"{self.participant}: rest a fingertip on {where} with {self.force:g} N, a weight of "
            f"{self.force / 0.00980665:.0f} g, and hold still."
        )


@dataclass(frozen=True)
class LiftFinger:
    """Take every finger and hand off the table."""

    def __str__(self) -> str:
        return "Take every finger and hand off the table."


Request = (
    Touch
    | RestFinger
    | LiftFinger
    | Target
    | TakeTarget
    | Press
    | Rest
    | Consent
    | Ready
    | Aim
    | Cable
    | Uncable
    | ConfirmSettings
    | Place
    | Remove
)


class UnansweredError(InstrumentError):
    """Nobody is there to answer a request: neither yes nor no."""


class Operator(ABC):
    """The person at the rig."""

    @abstractmethod
    def tell(self, request: Request) -> None:
        """Show a request and return at once: the person's response is measured meanwhile."""

    @abstractmethod
    def confirm(self, request: Request) -> bool:
        """Ask, and wait for the answer: True when the request is done or the answer is yes."""

    def rejects(self) -> bool:
        """True when the operator has rejected the previous press since the last call. Never waits."""
        return False

    def paused(self) -> bool:
        """True while the operator wants a session to pause. Never waits."""
        return False

    def notes(self) -> Sequence[str]:
        """Notes that the operator has written since the last call. Never waits."""
        return ()
