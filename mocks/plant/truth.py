"""The truth of a plant, which no instrument shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haploop.instruments.arrays import ComplexArray, FloatArray
from haploop.mocks.plant.buttons import SimulatedPress
from haploop.mocks.plant.scene import AmplifierOutput, Scene
from haploop.mocks.plant.table import MAIN

__all__ = ["Truth"]


@dataclass(frozen=True, eq=False)
class Truth:
    """What only a simulator can know: for tests and reports, never for an estimator."""

    _scene: Scene

    @property
    def presses(self) -> tuple[SimulatedPress, ...]:
        """Every press so far, in order."""
        return tuple(self._scene.presses)

    @property
    def resonance_hz(self) -> float:
        """Natural frequency of the mode near 263.5 Hz, now."""
        return float(self._scene.plate.natural_hz[MAIN])

    def velocity_response(self, patch: str, point: str, frequencies: FloatArray) -> ComplexArray:
        """(frequencies,) m/s per V at the patch, hysteresis left out."""
        return self._scene.plate.velocity(patch, self._scene.place(point), frequencies)

    @property
    def patch_voltages(self) -> dict[str, float]:
        """Voltage across each patch now."""
        scene = self._scene
        now = np.array([scene.clock.now()])
        scene.advance(now[0])
        return {p: float(scene.table.voltage(p, now)[0]) for p in scene.table.plate.patches}

    @property
    def closed(self) -> frozenset[str]:
        """Patches whose contacts are closed now."""
        self._scene.advance(self._scene.clock.now())
        return frozenset(self._scene.closed)

    @property
    def peak(self) -> float:
        """Largest voltage (V) that any patch has been driven with so far."""
        return self._scene.peak

    def record(self) -> list[AmplifierOutput]:
        """Record the amplifier's output from now on; returns the list that grows."""
        scene = self._scene
        scene.advance(scene.clock.now())
        scene.amplifier_record = []
        return scene.amplifier_record
