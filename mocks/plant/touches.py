"""Fingers on the surface: force and contact area over time, and fingertips and palms that rest on it.

Area follows force as between a sphere and a plane (Hertz: the power 2/3), with a scale of each person's own.
All figures are estimates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...base.arrays import FloatArray
from ...instruments.operator import Touch
from .surface import Contact

AREA_AT_1_N = 70e-6
"""m^2, of the mean person."""
_FORCES = {"light": (0.4, 0.6), "firm": (3.5, 4.5), "as a button": (2.8, 4.0)}
"""Limits of the peak force (N)."""


@dataclass(frozen=True)
class Skin:
    """One participant's fingertip."""

    area: float
    """Contact area at 1 N (m^2)."""
    tremor: float
    """Relative amplitude of the force's tremor."""
    tremor_hz: float


@dataclass(frozen=True)
class SimulatedTouch:
    """One press of the surface."""

    participant: str
    pressure: str
    start: float
    """First contact (s of the plant's clock)."""
    rise: float
    hold: float
    fall: float
    peak: float
    """Force at which it rests (N)."""
    skin: Skin
    phase: float

    @property
    def stop(self) -> float:
        """End of the contact (s)."""
        return self.start + self.rise + self.hold + self.fall

    def force(self, times: FloatArray) -> FloatArray:
        """Force (N) at times (s)."""
        up = np.clip((times - self.start) / self.rise, 0, 1)
        down = np.clip((self.stop - times) / self.fall, 0, 1)
        shape = np.sin(np.pi / 2 * up) ** 2 * np.sin(np.pi / 2 * down) ** 2
        tremor = self.skin.tremor * np.sin(
            2 * np.pi * self.skin.tremor_hz * (times - self.start) + self.phase
        )
        return np.asarray(self.peak * shape * (1 + tremor))

    def area(self, times: FloatArray) -> FloatArray:
        """Contact area (m^2) at times (s)."""
        return np.asarray(self.skin.area * self.force(times) ** (2 / 3))


def skin_of(rng: np.random.Generator) -> Skin:
    """Draw the fingertip of one participant."""
    return Skin(
        AREA_AT_1_N * float(np.exp(rng.normal(0, 0.15))),
        float(rng.uniform(0.02, 0.06)),
        float(rng.uniform(8, 12)),
    )


def touch_surface(request: Touch, skin: Skin, start: float, rng: np.random.Generator) -> SimulatedTouch:
    """Make the press of a request that begins at `start` (s)."""
    return SimulatedTouch(
        participant=request.participant,
        pressure=request.pressure,
        start=start,
        rise=float(rng.uniform(0.10, 0.16)),
        hold=float(rng.uniform(0.15, 0.30)),
        fall=float(rng.uniform(0.08, 0.14)),
        peak=float(rng.uniform(*_FORCES[request.pressure])),
        skin=skin,
        phase=float(rng.uniform(0, 2 * np.pi)),
    )


# Fingertips and palms that rest on a surface, and how they come, hold and leave.
#
# A fingertip is its pulp, a spring and a damper that stiffen with the force, on a phalanx:
# k = 1300 F^0.7 N/m and c = 1.8 F^0.35 N s/m (F in N) on 6 g, for the mean person. A palm is six such bodies
# over the size of a hand, together 8000 N/m, 12 N s/m and 150 g at 5 N. Nobody holds a force: it wanders. All
# figures are estimates (docs/hardware.md, "Fingers on the table").

_STIFFNESS, _STIFFENS = 1300.0, 0.7
_DAMPING, _DAMPS = 1.8, 0.35
_PHALANX = 0.006
_PEOPLE = (0.30, 0.25, 0.15)
"""Standard deviations between people of stiffness, damping and mass (logarithms)."""
_PALM = (8000.0, 12.0, 0.15)
_PALM_AT = 5.0
_SPREAD = (0.08, 0.09)
"""Half the size of a palm, as fractions of the default table: 80 x 63 mm in all."""
_RISE, _FALL = 0.12, 0.10
"""Time in which a force comes and goes (s)."""
_STEP, _HELD = 0.01, 0.2
"""Intervals at which a force changes in steps, while it comes or goes, and while it is held (s)."""
_WANDER, _WANDER_HZ = 0.06, (0.13, 0.41, 1.1)
"""Standard deviation of a held force, relative, and the frequencies of its wandering."""
_LEAST = 0.01
"""Least force of a contact (N)."""


class Resting(Protocol):
    """What can rest on a surface with a force."""

    def at(self, name: str, place: tuple[float, float], force: float) -> tuple[Contact, ...]:
        """Return the bodies at a place, pressed with a force (N)."""


@dataclass(frozen=True)
class Fingertip:
    """One person's fingertip, at 1 N."""

    stiffness: float = _STIFFNESS
    """N/m."""
    damping: float = _DAMPING
    """N s/m."""
    phalanx: float = _PHALANX
    """kg."""

    @classmethod
    def of(cls, rng: np.random.Generator) -> Fingertip:
        """Draw a person's."""
        k, c, m = np.exp(np.array(_PEOPLE) * rng.standard_normal(3))
        return cls(_STIFFNESS * float(k), _DAMPING * float(c), _PHALANX * float(m))

    def at(self, name: str, place: tuple[float, float], force: float) -> tuple[Contact, ...]:
        """See `Resting.at`."""
        stiffness, damping = self.stiffness * force**_STIFFENS, self.damping * force**_DAMPS
        return (Contact(name, place, stiffness, damping, self.phalanx),)


@dataclass(frozen=True)
class Palm:
    """One person's palm; `scale` multiplies the mean one's stiffness, damping and mass."""

    scale: float = 1.0

    @classmethod
    def of(cls, rng: np.random.Generator) -> Palm:
        """Draw a person's."""
        return cls(float(np.exp(_PEOPLE[1] * rng.standard_normal())))

    def at(self, name: str, place: tuple[float, float], force: float) -> tuple[Contact, ...]:
        """See `Resting.at`."""
        share = force / _PALM_AT
        k, c, m = (self.scale * whole / 6 for whole in _PALM)
        places = [
            (
                float(np.clip(place[0] + across * _SPREAD[0], 0.02, 0.98)),
                float(np.clip(place[1] + along * _SPREAD[1], 0.02, 0.98)),
            )
            for across in (-1.0, 0.0, 1.0)
            for along in (-1.0, 1.0)
        ]
        return tuple(
            Contact(f"{name} {number}", where, k * share**_STIFFENS, c * share**_DAMPS, m)
            for number, where in enumerate(places)
        )


class Hand:
    """Something that comes to a place, rests there with a force, and leaves; times are the plant's (s)."""

    def __init__(
        self,
        name: str,
        resting: Resting,
        place: tuple[float, float],
        force: float,
        begin: float,
        rng: np.random.Generator,
        end: float = math.inf,
    ) -> None:
        self.name = name
        self.begin, self.end = begin, end
        self._resting, self._place, self._force = resting, place, force
        self._phases = rng.uniform(0, 2 * np.pi, len(_WANDER_HZ))
        self._last: float | None = None

    def lift(self, now: float) -> None:
        """Let it leave from `now` on."""
        if self._last is None:
            self.begin = self.end = math.inf
        else:
            self.end = min(self.end, max(now, self._last))

    @property
    def due(self) -> float:
        """Time of its next change; infinite when there will be none."""
        if self._last is None:
            return self.begin
        if self._last < self.end:
            step = _STEP if self._last < self.begin + _RISE else _HELD
            return min(self._last + step, self.end)
        stop = self.end + _FALL
        return min(self._last + _STEP, stop) if self._last < stop else math.inf

    def change(self) -> tuple[Contact, ...]:
        """Make the change that is due, and return the bodies that rest on the surface from then on."""
        now = self._last = self.due
        if now >= self.end + _FALL:
            return ()
        return self._resting.at(self.name, self._place, max(self.force(now + _STEP / 2), _LEAST))

    def force(self, time: float) -> float:
        """Force (N) at a time (s)."""
        return float(self.felt(np.array(time)))

    def felt(self, times: FloatArray) -> FloatArray:
        """Force (N) at times (s), an array of any shape."""
        up = np.clip((times - self.begin) / _RISE, 0, 1)
        down = np.clip((self.end + _FALL - times) / _FALL, 0, 1)
        turns = 2 * np.pi * np.array(_WANDER_HZ) * times[..., None] + self._phases
        wander = _WANDER * math.sqrt(2 / len(_WANDER_HZ)) * np.sin(turns).sum(axis=-1)
        shape = np.sin(np.pi / 2 * up) ** 2 * np.sin(np.pi / 2 * down) ** 2
        return np.asarray(self._force * shape * np.maximum(1 + wander, 0.1))
