"""A fault: a seeded schedule of misbehaviour that acts on the simulated world through the plant's hooks.

A rig file lists faults in `[[simulation.faults]]`. There are three sorts. A permanent fault is a miswired
or misset rig, wrong from the beginning. A timed fault is active for a while, once or several times. A
per-event fault affects single events: a command to the relay, a read of the DAQ, a reply on a line. Times
are seconds of the plant's clock since the rig was opened; with `within`, the seed chooses the time.

A kind of fault is a subclass of `Fault`, `TimedFault` or `PerEventFault` that overrides the hooks of the
place where it acts. The plant calls each hook of all its faults, in the order of the rig file. A kind is
found by its entry point, so that other packages can add kinds (see docs/reference/faults.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ...instruments.arrays import BoolArray, FloatArray
from ...instruments.bounded import NotNegative, Positive
from ...instruments.config import RigFile
from ..transport import ReplyFault
from .hysteresis import PatchLaw
from .modal import Modes
from .nodes import LaserHead, Run

__all__ = [
    "Fault",
    "FaultSettings",
    "PerEventFault",
    "RelayFailure",
    "ScheduledFault",
    "TimedFault",
]


RelayFailure = Literal["lost", "stuck", "welded"]
"""lost: a command never reaches the box. stuck: a channel does not switch, and reports its real state.
welded: a contact does not switch, but the box reports the commanded state."""


class FaultSettings(BaseModel):
    """One table of `[[simulation.faults]]`; `kind` is the name of its entry point."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: str


class Fault:
    """One fault of a simulated rig: its settings, when it fired, and the hooks through which it acts.

    This base class is a permanent fault without any effect. A hook gets the plant's value, as the earlier
    faults of the rig file have changed it, and returns the value for the plant to use. A hook that has an
    effect records it by `mark`, `active` or `fires`.
    """

    Settings: ClassVar[type[FaultSettings]] = FaultSettings
    """Model that validates the fault's table of the rig file."""
    settings: FaultSettings

    def __init__(self, settings: FaultSettings, file: RigFile, rng: np.random.Generator) -> None:
        """Store the settings. `rng` is the fault's own; a subclass draws from it after this constructor."""
        self.settings = settings
        self.at: list[float] = []
        """Times at which it fired (s of the plant's clock)."""

    @property
    def kind(self) -> str:
        """Name of the kind in rig files."""
        return self.settings.kind

    @property
    def fired(self) -> int:
        """Number of effects so far: at most 1 if permanent, else one per active period or event."""
        return len(self.at)

    @property
    def begin(self) -> float:
        """Earliest time at which it is active (s of the plant's clock)."""
        return 0.0

    def mark(self, now: float) -> None:
        """Record the first effect of a permanent fault."""
        if not self.at:
            self.at.append(now)

    def __repr__(self) -> str:
        return f"<fault {self.kind}, fired {self.fired} times>"

    # Hooks: the surface and its patches

    every: float = math.inf
    """Interval at which `modes` is asked anew (s)."""

    def modes(self, modes: Modes, time: float) -> Modes:
        """Return the surface's modes at a time (s), as many as there were.

        A plant whose surface has no modes is refused with a kind that overrides this.
        """
        return modes

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        """Return the law of a patch, when the plant is created."""
        return law

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """Return the volts at each patch, (steps,), from `start` (s) on."""
        return volts

    # Hooks: the amplifier

    def gain(self, gain: float, run: Run) -> float:
        """Return the amplifier's gain (V per V, before the tolerance) for a run of its input."""
        return gain

    def output(self, volts: FloatArray, times: FloatArray) -> FloatArray:
        """Return the volts at the amplifier's output, (times,)."""
        return volts

    # Hooks: the relay

    def contact(self, patch: str, at: float) -> str:
        """Return the patch that the contact for `patch` really switches, at `at` (s)."""
        return patch

    def relay(self, how: RelayFailure, patch: str, now: float) -> bool:
        """Return True when the box's channel of a patch fails in this way now; called at each such event."""
        return False

    # Hooks: the cards of the DAQ

    def rtsi(self, now: float) -> bool:
        """Return True when a cable joins the cards' clocks."""
        return True

    def samples(self, device: str, now: float) -> None:
        """Called when a card is read. Raises SamplesLost when the card has lost samples."""

    def plays(self, device: str, now: float) -> None:
        """Called when a card is asked how far its play is. Raises PlayStopped when that has ended."""

    def lateness(self, device: str, times: FloatArray) -> FloatArray:
        """Return the delay that this fault adds to a card's clock, (times,) s."""
        return np.zeros(len(times))

    def channel(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        """Return the volts of a node at the card's terminal, (times,)."""
        return volts

    # Hooks: the sensors

    def gauges(self, gauges: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the real force sensor's sensitivity, (6, 6) V per N and N m. `rng` is the sensor's own."""
        return gauges

    def tilt(self, tilt: FloatArray) -> FloatArray:
        """Return the fraction of a vertical acceleration on each axis of the accelerometer, (3,)."""
        return tilt

    # Hooks: the laser

    def head(self, head: LaserHead) -> None:
        """Called when a vibrometer's head is installed; change `head` in place to its real state."""

    def inspected(self, now: float) -> None:
        """Called when a person inspects the settings of the vibrometers."""

    def light(self, level: FloatArray, times: FloatArray) -> FloatArray:
        """Return the fraction of the laser's light that returns, (times,)."""
        return level

    def velocity(
        self, velocity: FloatArray, times: FloatArray, full_scale: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return the velocity at the vibrometer's output, (times,) m/s; its full scale is +- `full_scale`.

        `rng` is the generator of its noise.
        """
        return velocity

    # Hooks: the camera under the surface

    def lamp(self, level: float, time: float) -> float:
        """Return the light that reaches the camera without a finger, in grey levels at the image's centre."""
        return level

    def blur(self, pixels: float, time: float) -> float:
        """Return the standard deviation of the camera's blur (pixels)."""
        return pixels

    def other_finger(self, time: float) -> float:
        """Return the contact area of another finger on the surface (m^2); 0 for none."""
        return 0.0

    def frame_lost(self, time: float) -> bool:
        """Return True when the frame of this time is lost; called for each frame."""
        return False

    # Hooks: the lines to instruments

    @property
    def line(self) -> str | None:
        """Role of the instrument whose line it disturbs; a rig without such a line is refused."""
        return None

    def answer(self, request: str, now: float) -> ReplyFault | None:
        """Return the fault of the answer to a request on that line; None leaves the answer intact."""
        return None


class ScheduledFault(Fault):
    """A fault that begins at a time."""

    class Settings(FaultSettings):
        """See `FaultSettings`."""

        after: NotNegative = 0.0
        """Earliest begin (s since the rig was opened)."""
        within: NotNegative = 0.0
        """Length of the interval after `after` in which the seed chooses the begin (s)."""

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
        """Length of an active period (s); infinite until the rig is closed."""
        times: Annotated[int, Field(ge=1)] = 1
        """Number of active periods."""
        every: Positive = 1.0
        """Mean time from one begin to the next (s), when there are several."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        gaps = settings.every * rng.uniform(0.5, 1.5, settings.times - 1)
        self._begins = self._begin + np.concatenate([np.zeros(1), np.cumsum(gaps)])

    def active(self, times: FloatArray) -> BoolArray:
        """Return True where it is active, (times,), for rising `times` (s); record each begin."""
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
        """Number of events that it affects; None for all."""

    settings: Settings

    def fires(self, now: float) -> bool:
        """Return True when it affects an event that happens now, and record it."""
        times = math.inf if self.settings.times is None else self.settings.times
        if now < self.begin or self.fired >= times:
            return False
        self.at.append(now)
        return True
