"""A fault: a seeded schedule of misbehaviour that acts on the simulated world at a place.

A rig file lists faults in `[[simulation.faults]]`. There are three sorts. A permanent fault is a miswired
or misset rig, wrong from the beginning. A timed fault is active for a while, once or several times. A
per-event fault affects single events: a command to the relay, a read of the DAQ, a reply on a line. Times
are seconds of the plant's clock since the rig was opened; with `within`, the seed chooses the time.

A kind of fault is a subclass of `Fault`, `TimedFault` or `PerEventFault`, which say when it acts, and of
the places where it sits (`places.py`), whose hooks it overrides. The plant calls the hooks of all faults at
a place, in the order of the rig file. haploop's own kinds stand in a table, and
other packages add kinds by entry points (see docs/reference/faults.md).
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from ...base.arrays import BoolArray, FloatArray
from ...base.bounded import Count, NotNegative, Positive, Strict
from ...instruments.config import RigFile


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
