"""State of a simulated table and of people's actions on it, read by the sensors and by `Truth`."""

from __future__ import annotations

import threading
import zlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock
from haploop.instruments.config import RigFile, TableSettings
from haploop.instruments.operator import Press
from haploop.mocks.plant.buttons import FLAWS, Finger, Flaw, SimulatedPress, button_named, press_button
from haploop.mocks.plant.fault_kinds import Faults
from haploop.mocks.plant.nodes import LaserHead
from haploop.mocks.plant.table import Plate, TouchTable, make_plate, warmed

__all__ = ["GRAVITY", "AmplifierOutput", "Scene"]

GRAVITY = 9.80665


@dataclass(frozen=True, eq=False)
class AmplifierOutput:
    """A section of the amplifier's output: value k is held from `start + k * period` (s) until the next one.

    `volts` is (samples,) V, applied to the patches whose contacts are `closed`.
    """

    start: float
    period: float
    volts: FloatArray
    closed: frozenset[str]


class Scene(ABC):
    """The table of one rig, the fingers and weights on it, and the aim of the laser.

    A scene is static; the plant implements `advance`, which steps it through time.
    """

    def __init__(self, file: RigFile, clock: Clock) -> None:
        self.file = file
        self.clock = clock
        self.settings = file.simulation
        # The patch's default limits: docs/hardware.md, "Patches".
        self.section = file.table or TableSettings(
            button_point=20, patch_capacitance=90e-9, patch_min=-100, patch_max=400
        )
        self.faults = Faults.of_file(file)
        self.presses: list[SimulatedPress] = []
        self.loads: list[tuple[float, float]] = []
        """Additional weights on the force sensor: the time from which each applies (s), and its force (N)."""
        self.aimed = "button"
        self.closed: set[str] = set()
        """Patches whose contacts are closed."""
        self.peak = 0.0
        """Largest voltage magnitude applied to any patch (V)."""
        self.amplifier_record: list[AmplifierOutput] | None = None
        self.shaken: dict[tuple[float, float], tuple[FloatArray, FloatArray]] = {}
        """Filtered vibrations of presses, kept for a sensor's next block."""
        self._lock = threading.RLock()
        self._heads: list[tuple[LaserHead, LaserHead]] = []
        self._pane = self._make_plate()
        self.table = TouchTable(self._pane, self.settings.hysteresis)

    @abstractmethod
    def advance(self, until: float) -> None:
        """Step the scene to `until` (s)."""

    def rng(self, name: str) -> np.random.Generator:
        """Return the random generator of one part of the world, independent of the other parts."""
        return np.random.default_rng([self.settings.seed, zlib.crc32(name.encode())])

    @property
    def plate(self) -> Plate:
        """The pane in its present state."""
        return self.plate_at(self.clock.now())

    def plate_at(self, time: float) -> Plate:
        """Return the pane at a time (s), with the frequency drift of the day's temperature."""
        daily = self.settings.daily_drift
        return warmed(self._pane, time, daily, self.settings.seed) if daily else self._pane

    def _make_plate(self) -> Plate:
        s = self.settings
        under = self.place("button") if s.collocated else None
        plate = make_plate(self.rng("table"), s.mode_drift, s.damping_scale, under)
        for fault in self.faults:
            plate = fault.plate(plate)
        return plate

    def place(self, point: str) -> tuple[float, float]:
        """Return the position of a point of the table, as fractions of its width and height."""
        index = self.section.button_point if point == "button" else int(point)
        row, column = divmod(index, self.section.columns)
        return (column + 0.5) / self.section.columns, (row + 0.5) / self.section.rows

    # Actions of people

    def press(self, request: Press) -> None:
        """Schedule a participant's press of a button, after the reaction time."""
        with self._lock:
            finger = Finger.of(self.rng(f"finger of {request.participant}"))
            # The seed depends on the request alone, so that the press is the same whatever came before.
            name = f"{request.participant} presses {request.button}, {request.number}"
            rng = self.rng(name if request.attempt == 1 else f"{name}, attempt {request.attempt}")
            button, flaw = button_named(request.button), self._flaw(name, request.attempt)
            start = self.clock.now() + finger.reaction * float(rng.uniform(0.8, 1.25))
            self.presses.append(press_button(button, finger, request, start, rng, flaw))
            if flaw == "double":
                again = self.presses[-1].stop + float(rng.uniform(0.03, 0.2))
                self.presses.append(press_button(button, finger, request, again, rng, flaw))

    def _flaw(self, press: str, attempt: int) -> Flaw:
        """Return the flaw of an attempt at a press, or "". From the third attempt on there is none."""
        rng = self.rng(f"{press}, attempt {attempt}: clumsy")
        bad = rng.random() < self.settings.bad_press_rate and attempt <= 2
        return FLAWS[int(rng.integers(len(FLAWS)))] if bad else ""

    def aim(self, point: str) -> None:
        """Aim the laser at a point of the table."""
        with self._lock:
            self.place(point)
            self.aimed = point

    def put(self, mass: float) -> None:
        """Set the additional mass on the force sensor to `mass` (kg), from now on."""
        with self._lock:
            self.loads.append((self.clock.now(), mass * GRAVITY))

    def _put_up(self, head: LaserHead) -> None:
        """Install a vibrometer's `head`, given as the rig file describes it."""
        self._heads.append((head, replace(head)))
        for fault in self.faults:
            fault.head(head)
        self.table.laser_pole_hz = head.bandwidth_hz

    @property
    def set_as_filed(self) -> bool:
        """True when every vibrometer has the rig file's settings: the simulated operator's answer."""
        for fault in self.faults:
            fault.inspected(self.clock.now())
        return all((head.range, head.scale) == (filed.range, filed.scale) for head, filed in self._heads)
