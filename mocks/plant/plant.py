"""The plant: the simulated physical world of one rig, as nodes that carry a voltage.

Everything simulated touches the plant and nothing else. Nodes have the names that the rig file
gives to DAQ channels and outputs. Time is the rig's clock; the plant never runs ahead of a
question: it steps exactly as far as it is asked.
"""

from __future__ import annotations

import threading
import zlib
from bisect import insort
from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock
from haploop.instruments.config import RigFile, TableSettings
from haploop.instruments.operator import Press
from haploop.mocks.faults import (
    AmplifierGain,
    AmplifierTrip,
    ClockDrift,
    DaqOverflow,
    DaqOverrun,
    Faults,
    PatchDead,
    RelaySwapped,
    RtsiMissing,
    SensorDisconnected,
    SensorSaturated,
    VibrometerRange,
    box_faults,
)
from haploop.mocks.plant.buttons import FLAWS, Finger, Flaw, SimulatedPress, button_named, press_button
from haploop.mocks.plant.nodes import Run, Source
from haploop.mocks.plant.sensed import GRAVITY, LaserHead, laser, wired
from haploop.mocks.plant.table import Plate, TouchTable, make_plate, warmed
from haploop.mocks.plant.truth import AmplifierOutput, Truth
from haploop.mocks.relay.box import BoxFault, SimulatedBox

__all__ = ["LaserHead", "Plant"]

AMPLIFIER_GAIN, AMPLIFIER_GAIN_ERROR = 50.0, 0.01
AMPLIFIER_LOW, AMPLIFIER_HIGH = -100.0, 400.0
RAIL = 15.0
"""V of a saturated sensor's output: its supply, beyond every converter's range (estimate)."""
_NOWHERE = (0.0, 0.0)
"""The pane's corner, where no mode has curvature: a patch there moves nothing."""
_TUNED = 10.0
"""Seconds after which the table's modes are made anew for the warmth that it has become: at 1 % a day they
have moved by less than a millionth."""


class Plant:
    """See the module. A laser looks at the table once a vibrometer's twin has installed its head."""

    def __init__(self, file: RigFile, clock: Clock) -> None:
        self.clock = clock
        self.settings = file.simulation
        self.presses: list[SimulatedPress] = []
        self.closed: set[str] = set()
        self.peak = 0.0
        self.amplifier_record: list[AmplifierOutput] | None = None
        self.file = file
        self.section = file.table or TableSettings(
            button_point=20, patch_capacitance=90e-9, patch_min=-100, patch_max=400
        )
        self.faults = Faults.of_file(file)
        self._lock = threading.RLock()
        self.aimed = "button"
        self._switched: list[tuple[float, int, str, bool]] = []
        self._boxes: list[SimulatedBox] = []
        self._sources: dict[str, Source] = {}
        self._now = clock.now()
        self._input_of = self._amplifier_inputs()
        self._inputs = dict.fromkeys(self._input_of.values(), 0.0)
        self._heads: list[tuple[LaserHead, LaserHead]] = []
        self.loads: list[tuple[float, float]] = []
        self._pane = self._make_plate()
        self._tuned = -np.inf
        self.table = TouchTable(self._pane, self.settings.hysteresis)
        gain = next((fault.settings.gain for fault in self.faults.of(AmplifierGain)), AMPLIFIER_GAIN)
        self._gain = gain * (1 + AMPLIFIER_GAIN_ERROR * self.rng("amplifier").uniform(-1, 1))
        self._terminals: dict[str, str] = {
            node: str(channel["terminal"]).split("/")[0]
            for node, channel in file.daq.settings.get("channels", {}).items()
            if isinstance(channel, dict) and "terminal" in channel
        }
        self._nodes = wired(self)
        self.shaken: dict[tuple[float, float], tuple[FloatArray, FloatArray]] = {}
        self._noise = {node: self.rng(f"noise of {node}") for node in self._nodes}

    def rng(self, name: str) -> np.random.Generator:
        """The random generator of one part of the plant, independent of the other parts'."""
        return np.random.default_rng([self.settings.seed, zlib.crc32(name.encode())])

    @property
    def plate(self) -> Plate:
        """The pane as it is now."""
        return self._warmed(self.clock.now())

    @property
    def truth(self) -> Truth:
        """See `Truth`."""
        return Truth(self)

    def place(self, point: str) -> tuple[float, float]:
        """Where a point of the table lies, as fractions of its width and height."""
        index = self.section.button_point if point == "button" else int(point)
        row, column = divmod(index, self.section.columns)
        return (column + 0.5) / self.section.columns, (row + 0.5) / self.section.rows

    # What people and instruments do to the plant

    def install(self, node: str, head: LaserHead) -> None:
        """Put a vibrometer in place, its output wired to `node`; `head` as the rig file describes it."""
        self._heads.append((head, replace(head)))
        for fault in self.faults.of(VibrometerRange):
            head.scale *= fault.settings.range / head.range
            head.range = fault.settings.range
        self.table.laser_pole_hz = head.bandwidth_hz
        self._nodes[node] = partial(laser, head=head)
        self._noise[node] = self.rng(f"noise of {node}")

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

    @property
    def set_as_filed(self) -> bool:
        """Whether every vibrometer is set as the rig file says; the simulated operator answers this."""
        for fault in self.faults.of(VibrometerRange):
            fault.mark(self.clock.now())
        return all((head.range, head.scale) == (filed.range, filed.scale) for head, filed in self._heads)

    def put(self, mass: float) -> None:
        """Leave nothing but `mass` (kg) on the force sensor, from now on."""
        with self._lock:
            self.loads.append((self.clock.now(), mass * GRAVITY))

    def box_faults(self, patches: Mapping[str, int]) -> list[BoxFault]:
        """The faults of a relay box whose channels are wired to patches as given."""
        return box_faults(self.faults, patches, self.clock)

    def has_rtsi(self) -> bool:
        """Whether a cable joins the cards' clocks."""
        missing = self.faults.of(RtsiMissing)
        for fault in missing:
            fault.mark(self.clock.now())
        return not missing

    def switch(self, patch: str, closed: bool, at: float) -> None:
        """A relay contact changes at `at` (s), which does not lie before the latest question."""
        with self._lock:
            for fault in self.faults.of(RelaySwapped):
                if patch in fault.settings.patches:
                    fault.mark(at)
                    one, other = fault.settings.patches
                    patch = other if patch == one else one
            insort(self._switched, (max(at, self._now), len(self._switched), patch, closed))

    def wire(self, box: SimulatedBox) -> None:
        """See `haploop.mocks.relay.box.Contacts.wire`."""
        self._boxes.append(box)

    def drive(self, node: str, source: Source) -> None:
        """See `haploop.mocks.plant.nodes.Nodes.drive`. Only the amplifier's inputs reach anything."""
        with self._lock:
            self.advance(self.clock.now())
            if node in self._inputs:
                self._sources[node] = source

    # What converters ask of it

    def read(self, node: str, times: FloatArray) -> FloatArray:
        """See `haploop.mocks.plant.nodes.Nodes.read`. A node that nothing is wired to carries zero volts."""
        with self._lock:
            if not len(times):
                return np.zeros(0)
            self.advance(float(times[-1]))
            times = self._as_clocked(node, times)
            quantity = self._nodes.get(node)
            volts = quantity(self, times, self._noise[node]) if quantity else np.zeros(len(times))
            return self._as_wired(node, volts, times)

    def advance(self, until: float) -> None:
        """Step to `until` (s), contacts and output steps in order of time."""
        with self._lock:
            if until <= self._now:
                return
            for box in self._boxes:
                for patch, closed, at in box.take(until):
                    self.switch(patch, closed, at)
            while self._switched and self._switched[0][0] <= until:
                at, _, patch, closed = self._switched.pop(0)
                self._step_to(at)
                self.closed ^= {patch} if closed is not (patch in self.closed) else set()
                self._apply(at, np.inf, {node: np.array([v]) for node, v in self._inputs.items()})
            self._step_to(until)

    def _step_to(self, until: float) -> None:
        together: dict[tuple[float, float, int], dict[str, FloatArray]] = {}
        for node, source in self._sources.items():
            for run in source.take(until):
                if len(run.values):
                    key = (run.start, run.period, len(run.values))
                    together.setdefault(key, {})[node] = self._amplified(run)
        before = -np.inf
        for (start, period, count), driven in sorted(together.items(), key=lambda item: item[0]):
            if start < before:
                raise NotImplementedError(
                    "Outputs that step at once, but not on one clock, are not simulated."
                )
            held = {node: np.full(count, v) for node, v in self._inputs.items()}
            self._apply(start, period, held | driven)
            before = start + (count - 1) * period
        self._now = max(self._now, until)

    def _amplified(self, run: Run) -> FloatArray:
        volts = np.clip(run.values * self._gain, AMPLIFIER_LOW, AMPLIFIER_HIGH)
        for gain in self.faults.of(AmplifierGain):
            if volts.any():
                gain.mark(run.start)
        for trip in self.faults.of(AmplifierTrip):
            # A trip at zero output has no effect, so it does not fire.
            if volts.any():
                times = np.asarray(run.start + np.arange(len(volts)) * run.period, dtype=np.float64)
                volts = volts * ~trip.active(times)
        return np.asarray(volts)

    def _apply(self, start: float, period: float, outputs: Mapping[str, FloatArray]) -> None:
        """Step the table. `outputs` is (steps,) V of the amplifier by its input."""
        self._inputs.update({node: float(volts[-1]) for node, volts in outputs.items()})
        steps = len(next(iter(outputs.values()), ()))
        rest = np.zeros(steps)
        at = {
            p: outputs.get(self._input_of.get(p, ""), rest) if p in self.closed else rest
            for p in self.table.plate.patches
        }
        for fault in self.faults.of(PatchDead):
            if at.get(fault.settings.patch, rest).any():
                fault.mark(start)
        if steps:
            if self.settings.daily_drift and start - self._tuned >= _TUNED:
                self._tuned = start
                self.table.tune(self._warmed(start))
            self.table.step(start, period, at)
        for node, volts in outputs.items():
            closed = frozenset(p for p in self.closed if self._input_of.get(p) == node)
            if closed:
                self.peak = max(self.peak, float(np.abs(volts).max()))
            if self.amplifier_record is not None:
                self.amplifier_record.append(AmplifierOutput(start, period, volts, closed))

    def _amplifier_inputs(self) -> dict[str, str]:
        """The amplifier's input for each patch."""
        named = self.file.amplifier.settings.get("input") if self.file.amplifier else None
        if isinstance(named, dict):
            return {str(patch): str(node) for patch, node in named.items()}
        return dict.fromkeys(self.section.patches, str(named)) if named else {}

    def _make_plate(self) -> Plate:
        s = self.settings
        under = self.place("button") if s.collocated else None
        plate = make_plate(self.rng("table"), s.mode_drift, s.damping_scale, under)
        dead = {fault.settings.patch: _NOWHERE for fault in self.faults.of(PatchDead)}
        return replace(plate, patches={**plate.patches, **dead})

    def _warmed(self, time: float) -> Plate:
        daily = self.settings.daily_drift
        return warmed(self._pane, time, daily, self.settings.seed) if daily else self._pane

    # Faults of what is measured

    def _as_clocked(self, node: str, times: FloatArray) -> FloatArray:
        """When a node's card really samples; raises what the card says when it has lost samples."""
        device = self._terminals.get(node)
        for overrun in self.faults.of(DaqOverrun):
            if device and overrun.settings.device in (None, device) and overrun.fires(float(times[-1])):
                raise _lost(device, True)
        for overflow in self.faults.of(DaqOverflow):
            if device and overflow.settings.device in (None, device) and overflow.fires(float(times[-1])):
                raise _lost(device, False)
        late = self.lateness(device, times) if device else np.zeros(len(times))
        return np.asarray(times - late)

    def lateness(self, device: str, times: FloatArray) -> FloatArray:
        """(times,) s by which a card's clock is behind the rig's."""
        late = np.zeros(len(times))
        for drift in self.faults.of(ClockDrift):
            if device == self._drifting(drift.settings.device):
                late += drift.settings.drift * np.maximum(times - drift.begin, 0.0)
                if late[-1] > 0:
                    drift.mark(float(times[-1]))
        return late

    def _drifting(self, named: str | None) -> str | None:
        """The card that a clock drift affects: the named one, else the first without outputs."""
        outputs = self.file.daq.settings.get("outputs", {}).values()
        owners = {str(output["terminal"]).split("/")[0] for output in outputs}
        devices = self.file.daq.settings.get("devices", {})
        return named or next((device for device in devices if device not in owners), None)

    def _as_wired(self, node: str, volts: FloatArray, times: FloatArray) -> FloatArray:
        for loose in self.faults.of(SensorDisconnected):
            if loose.settings.channel == node:
                loose.mark(float(times[-1]))
                volts = np.zeros(len(times))
        for fault in self.faults.of(SensorSaturated):
            if fault.settings.channel == node:
                volts = np.where(fault.active(times), RAIL, volts)
        return volts


def _lost(device: str, overrun: bool) -> Exception:
    """What a card whose samples were lost says, on the wire and to its twin."""
    # NI's library is heavy, and a plant without such a fault does not need it.
    from haploop.mocks.daq.ni.errors import DaqmxError, DAQmxErrors  # noqa: PLC0415

    code = DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE if overrun else DAQmxErrors.INPUT_FIFO_OVERFLOW
    return DaqmxError(code, f"Samples of {device} were lost.", read=0)
