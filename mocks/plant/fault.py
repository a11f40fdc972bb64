"""A fault: a seeded schedule of misbehaviour that acts on the simulated world through the plant's hooks.

A rig file asks for faults in `[[simulation.faults]]`. There are three sorts. A permanent fault is a miswired
or misset rig, wrong from the beginning. A timed fault is active for a while, once or several times. A
per-event fault affects single events: a command to the relay, a read of the DAQ, a reply on a line. Times
are seconds of the plant's clock since the rig was opened; `within` lets the seed choose one.

A kind of fault is a subclass of `Fault`, `TimedFault` or `PerEventFault` that overrides the hooks of the
place where it acts. The plant asks all its faults at each hook, in the order of the rig file, and names
none. A kind is found by its entry point, so a package from outside can add one (see docs/faults.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from haploop.instruments.arrays import BoolArray, FloatArray
from haploop.instruments.config import RigFile
from haploop.mocks.plant.nodes import LaserHead, Run
from haploop.mocks.plant.table import Plate
from haploop.mocks.transport import ReplyFault

__all__ = [
    "Fault",
    "FaultSettings",
    "NotNegative",
    "PerEventFault",
    "Positive",
    "RelayFailure",
    "ScheduledFault",
    "TimedFault",
]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]

RelayFailure = Literal["lost", "stuck", "welded"]
"""lost: a command never reaches the box. stuck: a channel keeps its state, and reports it. welded: a contact
keeps its state, while the box reports the commanded one."""


class FaultSettings(BaseModel):
    """One table of `[[simulation.faults]]`; `kind` is the name of its entry point."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: str


class Fault:
    """One fault of a simulated rig: its settings, when it fired, and the hooks through which it acts.

    This base class is a permanent fault without any effect. A hook is given what the plant has, as the
    faults before it in the rig file have left it, and returns what the plant goes on with. A hook that has
    an effect records it: `mark`, `active` or `fires`.
    """

    Settings: ClassVar[type[FaultSettings]] = FaultSettings
    """Validates the fault's table of the rig file."""
    settings: FaultSettings

    def __init__(self, settings: FaultSettings, file: RigFile, rng: np.random.Generator) -> None:
        """`rng` is the fault's own; a subclass may draw from it after this constructor has."""
        self.settings = settings
        self.at: list[float] = []
        """When it fired (s of the plant's clock)."""

    @property
    def kind(self) -> str:
        """Its name in rig files."""
        return self.settings.kind

    @property
    def fired(self) -> int:
        """How often it had an effect: at most once if permanent, else once per active time or event."""
        return len(self.at)

    @property
    def begin(self) -> float:
        """Time (s of the plant's clock) before which it is not active."""
        return 0.0

    def mark(self, now: float) -> None:
        """Record the first effect of a permanent fault."""
        if not self.at:
            self.at.append(now)

    def __repr__(self) -> str:
        return f"<fault {self.kind}, fired {self.fired} times>"

    # Hooks: the table

    def plate(self, plate: Plate) -> Plate:
        """The pane, when it is made."""
        return plate

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """(steps,) V at each patch, from `start` (s) on."""
        return volts

    # Hooks: the amplifier

    def gain(self, gain: float, run: Run) -> float:
        """V per V, before the tolerance, with which the amplifier amplifies a run of its input."""
        return gain

    def output(self, volts: FloatArray, times: FloatArray) -> FloatArray:
        """(times,) V at the amplifier's output."""
        return volts

    # Hooks: the relay

    def contact(self, patch: str, at: float) -> str:
        """The patch behind the contact that the box knows as `patch`, when it switches at `at` (s)."""
        return patch

    def relay(self, how: RelayFailure, patch: str, now: float) -> bool:
        """Whether the box's channel of a patch fails in this way now; asked at each event of that sort."""
        return False

    # Hooks: the cards of the DAQ

    def rtsi(self, now: float) -> bool:
        """Whether a cable joins the cards' clocks."""
        return True

    def samples(self, device: str, now: float) -> None:
        """A card is read. Raises SamplesLost when it has lost samples."""

    def lateness(self, device: str, times: FloatArray) -> FloatArray:
        """(times,) s by which this fault makes a card's clock late."""
        return np.zeros(len(times))

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        """(times,) V at a node, as it reaches the card."""
        return volts

    # Hooks: the sensors

    def gauges(self, gauges: FloatArray, rng: np.random.Generator) -> FloatArray:
        """(6, 6) V per N and N m of the force sensor that is really there. `rng` is the sensor's own."""
        return gauges

    def tilt(self, tilt: FloatArray) -> FloatArray:
        """(3,) share of a vertical acceleration that each axis of the accelerometer shows."""
        return tilt

    # Hooks: the laser

    def head(self, head: LaserHead) -> None:
        """A vibrometer's head is put in place; change it as it really is."""

    def inspected(self, now: float) -> None:
        """A person looks at how the vibrometers are set."""

    def light(self, level: FloatArray, times: FloatArray) -> FloatArray:
        """(times,) share of the laser's light that comes back."""
        return level

    def velocity(
        self, velocity: FloatArray, times: FloatArray, full_scale: float, rng: np.random.Generator
    ) -> FloatArray:
        """(times,) m/s at the vibrometer's output, with full scale +- `full_scale`. `rng` is its noise's."""
        return velocity

    # Hooks: the lines to instruments

    @property
    def line(self) -> str | None:
        """The role of the instrument whose line it disturbs: without such a line the rig is refused."""
        return None

    def answer(self, request: str, now: float) -> ReplyFault | None:
        """How the answer to a request on that line is disturbed; None leaves it whole."""
        return None


class ScheduledFault(Fault):
    """A fault that begins at a time."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        after: NotNegative = 0.0
        """Seconds since the rig was opened."""
        within: NotNegative = 0.0
        """Seconds after `after` within which the seed chooses the begin."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._begin = settings.after + settings.within * rng.uniform()

    @property
    def begin(self) -> float:
        """See `Fault.begin`."""
        return self._begin


class TimedFault(ScheduledFault):
    """A fault that is active for a while, once or several times."""

    class Settings(ScheduledFault.Settings):
        """See `FaultSettings`."""

        duration: Annotated[float, Field(gt=0)] = math.inf
        """Seconds that it is active; infinite until the rig is closed."""
        times: Annotated[int, Field(ge=1)] = 1
        every: Positive = 1.0
        """Mean seconds from one begin to the next, when there are several."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        gaps = settings.every * rng.uniform(0.5, 1.5, settings.times - 1)
        self._begins = self._begin + np.concatenate([np.zeros(1), np.cumsum(gaps)])

    def active(self, times: FloatArray) -> BoolArray:
        """(times,): whether it is active at each of `times` (s, rising); records each begin."""
        on = np.zeros(len(times), dtype=np.bool_)
        for begin in self._begins:
            during = (times >= begin) & (times < begin + self.settings.duration)
            if during.any() and begin not in self.at:
                self.at.append(float(begin))
            on |= during
        return on


class PerEventFault(ScheduledFault):
    """A fault that affects single events."""

    class Settings(ScheduledFault.Settings):
        """See `FaultSettings`."""

        times: Annotated[int, Field(ge=1)] | None = None
        """How many events it affects; None is all of them."""

    settings: Settings

    def fires(self, now: float) -> bool:
        """Whether it affects an event that happens now; if so, record it."""
        times = math.inf if self.settings.times is None else self.settings.times
        if now < self.begin or self.fired >= times:
            return False
        self.at.append(now)
        return True
