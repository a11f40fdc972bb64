"""True state of a plant, which no instrument shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from .buttons import SimulatedPress
from .scene import AmplifierOutput, Scene
from .surface import Surface
from .touches import SimulatedTouch


@dataclass(frozen=True, eq=False)
class Truth:
    """True values known only to the simulator: for tests and reports, never for an estimator."""

    _scene: Scene

    @property
    def presses(self) -> tuple[SimulatedPress, ...]:
        """All presses so far, in order."""
        return tuple(self._scene.presses.all)

    @property
    def touches(self) -> tuple[SimulatedTouch, ...]:
        """All presses of the touch surface so far, in order."""
        return tuple(self._scene.touches)

    def contact_area(self, times: FloatArray) -> FloatArray:
        """Return the finger's contact area on the touch surface, (times,) m^2."""
        return self._scene.contact_area(np.asarray(times, dtype=np.float64))

    @property
    def resonance_hz(self) -> float:
        """Present resonance of the first patch at the button (Hz): of the table, its mode near 263.5 Hz."""
        scene = self._scene
        place = scene.place("button")
        return scene.surface.resonance_hz(scene.surface.patches[0], place, scene.clock.now())

    @property
    def surface(self) -> Surface:
        """The surface itself; of one that has modes, `surface.modes(time)` are these."""
        return self._scene.surface

    def velocity_response(self, patch: str, point: str, frequencies: FloatArray) -> ComplexArray:
        """Return the response without hysteresis, (frequencies,) m/s per V at the patch, as it is now."""
        scene = self._scene
        scene.advance(scene.clock.now())
        return scene.surface.response(patch, scene.place(point), frequencies, scene.clock.now())

    def velocity(self, point: str, times: FloatArray) -> FloatArray:
        """Return the surface's own velocity at a point, (times,) m/s, at rising times (s of the rig's clock).

        No laser is in it: no pole, delay, noise, clipping or fault, so that a judge can be compared with it.
        Times reach from 30 s before the last output step to the clock's present time, which the first call
        brings the plant to. Raises ValueError for times outside.
        """
        scene, times = self._scene, np.asarray(times, dtype=np.float64)
        now = scene.clock.now()
        if len(times) and times[-1] > now:
            raise ValueError(f"The motion at {times[-1]:.3f} s lies in the future: it is {now:.3f} s.")
        scene.advance(now)
        return scene.surface.velocity(scene.place(point), times)

    @property
    def patch_voltages(self) -> dict[str, float]:
        """Present voltage across each patch (V)."""
        scene = self._scene
        now = np.array([scene.clock.now()])
        scene.advance(now[0])
        return {p: float(scene.patches.voltage(p, now)[0]) for p in scene.surface.patches}

    @property
    def closed(self) -> frozenset[str]:
        """Patches with closed contacts, now."""
        self._scene.advance(self._scene.clock.now())
        return frozenset(self._scene.closed)

    @property
    def peak(self) -> float:
        """Largest voltage magnitude applied to any patch so far (V)."""
        return self._scene.peak

    def record(self) -> list[AmplifierOutput]:
        """Record the amplifier's output from now on; return the list, which grows with time."""
        scene = self._scene
        scene.advance(scene.clock.now())
        scene.amplifier_record = []
        return scene.amplifier_record

    def began(self, record: Sequence[AmplifierOutput]) -> float:
        """Time (s) at which the first waveform of a record began that a closed contact passed.

        Not its first volts: a waveform may begin with zeros. Raises LookupError where none was passed.
        """
        for one in record:
            if one.closed and np.isfinite(one.period):
                return one.start
        raise LookupError("no waveform was passed to a patch")
