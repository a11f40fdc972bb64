"""A finger on the touch surface: force over time, and the contact area that it makes.

Area follows force as between a sphere and a plane (Hertz: the power 2/3), with a scale of each person's own.
All figures are estimates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray
from ...instruments.operator import Touch

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
