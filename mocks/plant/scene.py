"""What stands at a simulated table, and what people do to it: the state that sensors and truth look at."""

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
    """A stretch of the amplifier's output: value k is held from `start + k * period` (s) until the next one.

    `volts` is (samples,) V, applied to the patches whose contacts are `closed`.
    """

    start: float
    period: float
    volts: FloatArray
    closed: frozenset[str]


class Scene(ABC):
    """The table of one rig, the fingers and weights on it, and where the laser is aimed.

    A scene stands still: `advance` is the plant's, which steps it through time.
    """

    def __init__(self, file: RigFile, clock: Clock) -> None:
        self.file = file
        self.clock = clock
        self.settings = file.simulation
        self.section = file.table or TableSettings(
            button_point=20, patch_capacitance=90e-9, patch_min=-100, patch_max=400
        )
        self.faults = Faults.of_file(file)
        self.presses: list[SimulatedPress] = []
        self.loads: list[tuple[float, float]] = []
        """From when (s), and N: what else stands on the force sensor."""
        self.aimed = "button"
        self.closed: set[str] = set()
        """Patches whose contacts are closed."""
        self.peak = 0.0
        """Largest voltage (V) that any patch has been driven with."""
        self.amplifier_record: list[AmplifierOutput] | None = None
        self.shaken: dict[tuple[float, float], tuple[FloatArray, FloatArray]] = {}
        """Vibrations of presses that a sensor has filtered, kept for its next block."""
        self._lock = threading.RLock()
        self._heads: list[tuple[LaserHead, LaserHead]] = []
        self._pane = self._make_plate()
        self.table = TouchTable(self._pane, self.settings.hysteresis)

    @abstractmethod
    def advance(self, until: float) -> None:
        """Step to `until` (s)."""

    def rng(self, name: str) -> np.random.Generator:
        """The random generator of one part of the world, independent of the other parts'."""
        return np.random.default_rng([self.settings.seed, zlib.crc32(name.encode())])

    @property
    def plate(self) -> Plate:
        """The pane as it is now."""
        return self.plate_at(self.clock.now())

    def plate_at(self, time: float) -> Plate:
        """The pane as it is at a time (s), in the warmth of the day."""
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
        """Where a point of the table lies, as fractions of its width and height."""
        index = self.section.button_point if point == "button" else int(point)
        row, column = divmod(index, self.section.columns)
        return (column + 0.5) / self.section.columns, (row + 0.5) / self.section.rows

    # What people do

    def press(self, request: Press) -> None:
        """A participant presses a button, after their reaction time from now."""
        with self._lock:
            finger = Finger.of(self.rng(f"finger of {request.participant}"))
            # Named by what was asked for alone: whatever happened before, it is the same press.
            name = f"{request.participant} presses {request.button}, {request.number}"
            rng = self.rng(name if request.attempt == 1 else f"{name}, attempt {request.attempt}")
            button, flaw = button_named(request.button), self._flaw(name, request.attempt)
            start = self.clock.now() + finger.reaction * float(rng.uniform(0.8, 1.25))
            self.presses.append(press_button(button, finger, request, start, rng, flaw))
            if flaw == "double":
                again = self.presses[-1].stop + float(rng.uniform(0.03, 0.2))
                self.presses.append(press_button(button, finger, request, again, rng, flaw))

    def _flaw(self, press: str, attempt: int) -> Flaw:
        """The flaw of an attempt at a press, or "". A third attempt has none."""
        rng = self.rng(f"{press}, attempt {attempt}: clumsy")
        bad = rng.random() < self.settings.bad_press_rate and attempt <= 2
        return FLAWS[int(rng.integers(len(FLAWS)))] if bad else ""

    def aim(self, point: str) -> None:
        """Aim the laser at a point of the table."""
        with self._lock:
            self.place(point)
            self.aimed = point

    def put(self, mass: float) -> None:
        """Leave nothing but `mass` (kg) on the force sensor, from now on."""
        with self._lock:
            self.loads.append((self.clock.now(), mass * GRAVITY))

    def _put_up(self, head: LaserHead) -> None:
        """Put a vibrometer's head in place, `head` being as the rig file describes it."""
        self._heads.append((head, replace(head)))
        for fault in self.faults:
            fault.head(head)
        self.table.laser_pole_hz = head.bandwidth_hz

    @property
    def set_as_filed(self) -> bool:
        """Whether every vibrometer is set as the rig file says; the simulated operator answers this."""
        for fault in self.faults:
            fault.inspected(self.clock.now())
        return all((head.range, head.scale) == (filed.range, filed.scale) for head, filed in self._heads)
