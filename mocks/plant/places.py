"""Faults: seeded schedules of misbehaviour, and the places of the simulated world at which they act.

A rig file lists faults in `[[simulation.faults]]`. There are three sorts. A permanent fault is a miswired
or misset rig, wrong from the beginning. A timed fault is active for a while, once or several times. A
per-event fault affects single events: a command to the relay, a read of the DAQ, a reply on a line. Times
are seconds of the plant's clock since the rig was opened; with `within`, the seed chooses the time.

A kind of fault is a subclass of `Fault`, `TimedFault` or `PerEventFault`, which say when it acts, and of
the places where it sits, whose hooks it overrides. A hook gets the plant's value, as the earlier faults of
the rig file have changed it, and returns the value for the plant to use; here each leaves it as it is.
haploop's own kinds stand in a table, and other packages add kinds by entry points (see
docs/reference/faults.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

import numpy as np

from ...base.arrays import BoolArray, FloatArray
from ...base.bounded import Count, NotNegative, Positive, Strict
from ...instruments.config import RigFile
from ...instruments.vibrometer import Quantity
from ...nidaqmx_twin.nodes import Run
from ..transport import ReplyFault
from .hysteresis import PatchLaw
from .modal import Modes
from .touches import Hand


class FaultSettings(Strict):
    """One table of `[[simulation.faults]]`; `kind` is its name in the table or of its entry point."""

    kind: str


class Fault:
    """One fault of a simulated rig: its settings, and when it fired.

    This base class is a permanent fault, at no place. A hook that has an effect records it by `mark`,
    `active` or `fires`.
    """

    Settings: ClassVar[type[FaultSettings]] = FaultSettings
    """Model that validates the fault's table of the rig file."""
    settings: FaultSettings
    begin = 0.0
    """Earliest time at which it is active (s of the plant's clock)."""

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

    def mark(self, now: float) -> None:
        """Record the first effect of a permanent fault."""
        if not self.at:
            self.at.append(now)

    def __repr__(self) -> str:
        return f"<fault {self.kind}, fired {self.fired} times>"


class ScheduledFault(Fault):
    """A fault that begins at a time."""

    class Settings(FaultSettings):
        after: NotNegative = 0.0
        """Earliest begin (s since the rig was opened)."""
        within: NotNegative = 0.0
        """Length of the interval after `after` in which the seed chooses the begin (s)."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self.begin = settings.after + settings.within * rng.uniform()


class TimedFault(ScheduledFault):
    """A fault that is active for a while, once or several times."""

    class Settings(ScheduledFault.Settings):
        duration: Positive = math.inf
        """Length of an active period (s); infinite until the rig is closed."""
        times: Count = 1
        """Number of active periods."""
        every: Positive = 1.0
        """Mean time from one begin to the next (s), when there are several."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        gaps = settings.every * rng.uniform(0.5, 1.5, settings.times - 1)
        self._begins = self.begin + np.concatenate([np.zeros(1), np.cumsum(gaps)])

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
        times: Count | None = None
        """Number of events that it affects; None for all."""

    settings: Settings

    def fires(self, now: float) -> bool:
        """Return True when it affects an event that happens now, and record it."""
        times = math.inf if self.settings.times is None else self.settings.times
        if now < self.begin or self.fired >= times:
            return False
        self.at.append(now)
        return True


# Relays and laser heads, as the plant sees them.

Switched = tuple[str, bool, float]
"""A patch, True when its contact closed or False when it opened, and the time (s)."""


class Switches(Protocol):
    """A box of relays, as the plant sees it."""

    def take(self, until: float) -> Sequence[Switched]:
        """Return, once, each contact that switches as a result of events up to `until` (s)."""


@dataclass
class LaserHead:
    """Real state of a vibrometer's optics and decoder, which may differ from the rig file's."""

    range: float
    """Full scale (m/s, or SI of `quantity`), at which the output clips."""
    scale: float
    """Scale of the output (SI per V)."""
    bandwidth_hz: float
    delay: float
    """Delay of the output (s)."""
    level: float = 1.0
    """Fraction of the light that returns, 0 to 1; without light the output is noise only."""
    quantity: Quantity = "velocity"
    """What it shows; range and scale are in its SI unit."""
    high_pass_hz: float = 0.0
    """Corner of its high-pass (Hz); 0 without."""
    zero: float = 0.0
    """Its output at zero (V)."""
    mass: float = 0.0
    """Mass that is glued to the surface (kg)."""


RelayFailure = Literal["lost", "stuck", "welded"]
"""lost: a command never reaches the box. stuck: a channel does not switch, and reports its real state.
welded: a contact does not switch, but the box reports the commanded state."""


class OnSurface(Fault):
    """Hooks at the surface and its patches."""

    every: float = math.inf
    """Interval at which `modes` is asked anew (s)."""

    def modes(self, modes: Modes, time: float) -> Modes:
        """Return the surface's modes at a time (s), as many as there were.

        A plant whose surface has no modes is refused with a kind that overrides this.
        """
        return modes

    def hands(self) -> Sequence[Hand]:
        """Return what rests on the surface for a while, when the plant is created."""
        return ()

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        """Return the law of a patch, when the plant is created."""
        return law

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        """Return the volts at each patch, (steps,), from `start` (s) on."""
        return volts


class OnAmplifier(Fault):
    """Hooks at the amplifier."""

    def gain(self, gain: float, run: Run) -> float:
        """Return the amplifier's gain (V per V, before the tolerance) for a run of its input."""
        return gain

    def output(self, volts: FloatArray, times: FloatArray) -> FloatArray:
        """Return the volts at the amplifier's output, (times,)."""
        return volts


class OnRelay(Fault):
    """Hooks at the relay."""

    def contact(self, patch: str, at: float) -> str:
        """Return the patch that the contact for `patch` really switches, at `at` (s)."""
        return patch

    def relay(self, how: RelayFailure, patch: str, now: float) -> bool:
        """Return True when the box's channel of a patch fails in this way now; called at each such event."""
        return False


class OnCards(Fault):
    """Hooks at the cards of the DAQ."""

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

    def scanned(self, nodes: Sequence[str], volts: FloatArray, times: FloatArray) -> None:
        """Change in place the volts, (nodes, times), of nodes that a card converts in this order."""


class OnSensors(Fault):
    """Hooks at the sensors."""

    def gauges(self, gauges: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the real force sensor's sensitivity, (channels, axes) V per N and N m. `rng` is its own."""
        return gauges

    def tilt(self, tilt: FloatArray) -> FloatArray:
        """Return the fraction of a vertical acceleration on two level axes and the vertical one, (3,)."""
        return tilt


class OnLaser(Fault):
    """Hooks at the laser."""

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


class OnCamera(Fault):
    """Hooks at the camera under the surface."""

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


class OnStreams(Fault):
    """Hooks at the senders of streams, each by its name in the rig file."""

    def stream_lost(self, stream: str, time: float) -> bool:
        """Return True when the stream is not there, at `time` (s)."""
        return False

    def samples_lost(self, stream: str, time: float) -> bool:
        """Return True when the sample of this time never arrives."""
        return False


class OnLine(Fault):
    """Hooks at the lines to instruments."""

    @property
    def line(self) -> str | None:
        """Role of the instrument whose line it disturbs; a rig without such a line is refused."""
        return None

    def answer(self, request: str, now: float) -> ReplyFault | None:
        """Return the fault of the answer to a request on that line; None leaves the answer intact."""
        return None


PLACES: tuple[type[Fault], ...] = (
    OnSurface,
    OnAmplifier,
    OnRelay,
    OnCards,
    OnSensors,
    OnLaser,
    OnCamera,
    OnStreams,
    OnLine,
)
"""Every place."""
