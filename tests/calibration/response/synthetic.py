"""Modes in numpy, exactly sampled, so that an estimator can be tried without a rig."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from haploop.calibration import LinearSweep
from haploop.calibration.response import Channels

RATE = 5000.0
AS_SAMPLED = Channels(RATE, 0.0, 0.0, lambda f: np.ones(len(f), dtype=np.complex128))


@dataclass(frozen=True)
class Plant:
    """Modes as sampled at RATE: the drive is a staircase, and the response is to its samples."""

    hz: tuple[float, ...]
    damping: tuple[float, ...]
    strength: tuple[float, ...]

    def _decays(self) -> tuple[np.ndarray, np.ndarray]:
        hz, damping = np.array(self.hz), np.array(self.damping)
        poles = 2 * np.pi * hz * (-damping + 1j * np.sqrt(1 - damping**2))
        return np.exp(poles / RATE), 1e-5 * np.array(self.strength) * hz / RATE

    def velocity(self, volts: np.ndarray) -> np.ndarray:
        decays, gains = self._decays()
        parts = (
            lfilter([0, g], [1, -d], volts.astype(np.complex128)) for d, g in zip(decays, gains, strict=True)
        )
        return np.asarray(sum(part.real for part in parts))

    def response(self, f: np.ndarray) -> np.ndarray:
        z = np.exp(2j * np.pi * f / RATE)[:, None]
        decays, gains = self._decays()
        return np.asarray((gains / 2 / (z - decays) + gains / 2 / (z - decays.conj())).sum(axis=1))


def swept(plant: Plant, sweep: LinearSweep, drift: float, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Drives and velocities (plays, samples) while all frequencies drift by `drift`."""
    rng = np.random.default_rng(6637)
    once = np.append(sweep.volts(RATE, 50.0), np.zeros(round(sweep.tail * RATE)))
    shares = (*(1.0,) * sweep.repeats, *sweep.shares)
    drives = np.array([share * once for share in shares])
    velocities = []
    for number, drive in enumerate(drives):
        moved = 1 + drift * number / (len(drives) - 1)
        now = replace(plant, hz=tuple(hz * moved for hz in plant.hz))
        velocities.append(now.velocity(drive) + noise * rng.standard_normal(len(drive)))
    return drives, np.array(velocities)
