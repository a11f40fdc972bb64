"""The truth of a plant, which no instrument shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from haploop.instruments.arrays import ComplexArray, FloatArray
from haploop.mocks.plant.buttons import SimulatedPress
from haploop.mocks.plant.table import MAIN

if TYPE_CHECKING:
    from haploop.mocks.plant.plant import Plant

__all__ = ["AmplifierOutput", "Truth"]


@dataclass(frozen=True, eq=False)
class AmplifierOutput:
    """A stretch of the amplifier's output: value k is held from `start + k * period` (s) until the next one.

    `volts` is (samples,) V, applied to the patches whose contacts are `closed`.
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
    def presses(self) -> tuple[SimulatedPress, ...]:
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

    def record(self) -> list[AmplifierOutput]:
        """Record the amplifier's output from now on; returns the list that grows."""
        plant = self._plant
        plant.advance(plant.clock.now())
        plant.amplifier_record = []
        return plant.amplifier_record
