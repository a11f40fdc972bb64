"""The truth of a plant, which no instrument shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from instruments.arrays import ComplexArray, FloatArray
from mocks.buttons import ButtonPress
from mocks.table import MAIN

if TYPE_CHECKING:
    from mocks.plant import Plant

__all__ = ["Fed", "Truth"]


@dataclass(frozen=True, eq=False)
class Fed:
    """What the amplifier put out: value k is held from `start + k * period` (s) until the next one.

    `volts` is (samples,) V, and reaches the patches that are `closed` meanwhile.
    """

    start: float
    period: float
    volts: FloatArray
    closed: frozenset[str]


@dataclass(frozen=True, eq=False)
class Truth:
    """What only a simulator can know: for tests and reports, never for an estimator."""

    _plant: Plant

    @property
    def presses(self) -> tuple[ButtonPress, ...]:
        """Every press so far, in order."""
        return tuple(self._plant.presses)

    @property
    def resonance_hz(self) -> float:
        """Natural frequency of the mode near 263.5 Hz, now."""
        return float(self._plant.plate.natural_hz[MAIN])

    def velocity_response(self, patch: str, point: str, frequencies: FloatArray) -> ComplexArray:
        """(frequencies,) m/s per V at the patch, hysteresis left out."""
        return self._plant.plate.velocity(patch, self._plant.place(point), frequencies)

    @property
    def patch_voltages(self) -> dict[str, float]:
        """Voltage across each patch now."""
        plant = self._plant
        now = np.array([plant.clock.now()])
        plant.advance(now[0])
        return {p: float(plant.table.voltage(p, now)[0]) for p in plant.table.plate.patches}

    @property
    def closed(self) -> frozenset[str]:
        """Patches whose contacts are closed now."""
        self._plant.advance(self._plant.clock.now())
        return frozenset(self._plant.closed)

    @property
    def peak(self) -> float:
        """Largest voltage (V) that any patch has been driven with so far."""
        return self._plant.peak

    def record(self) -> list[Fed]:
        """Write down from now on what the amplifier puts out, step by step; gives the growing record."""
        plant = self._plant
        plant.advance(plant.clock.now())
        plant.fed = []
        return plant.fed
