"""The plant: the simulated physical world of one rig, as nodes that carry a voltage.

Simulated parts interact only through the plant. Nodes have the names that the rig file gives to DAQ
channels and outputs. Time is the rig's clock; the plant steps only as far as a call requires.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import groupby

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock
from haploop.instruments.config import RigFile
from haploop.mocks.plant.amplifier import Amplifier
from haploop.mocks.plant.nodes import LaserHead, Source, Switches
from haploop.mocks.plant.scene import AmplifierOutput, Scene
from haploop.mocks.plant.sensed import Output, laser, wired
from haploop.mocks.plant.surface import PlantSource
from haploop.mocks.plant.truth import Truth

__all__ = ["Plant"]


class Plant(Scene):
    """The simulated world of one rig. A laser measures once a vibrometer's twin has installed its head."""

    def __init__(self, file: RigFile, clock: Clock, source: PlantSource | None = None) -> None:
        super().__init__(file, clock, source)
        self._switched: list[tuple[float, int, str, bool]] = []
        self._boxes: list[Switches] = []
        self._sources: dict[str, Source] = {}
        self._now = clock.now()
        self._amplifier = Amplifier(file, self.section.patches, self.rng("amplifier"))
        self._inputs = dict.fromkeys(self._amplifier.inputs.values(), 0.0)
        self._cards: dict[str, str] = {
            node: str(channel["terminal"]).split("/")[0]
            for node, channel in file.daq.settings.get("channels", {}).items()
            if isinstance(channel, dict) and "terminal" in channel
        }
        self._nodes = wired(self)
        self._noise = {node: self.rng(f"noise of {node}") for node in self._nodes}

    @property
    def truth(self) -> Truth:
        """See `Truth`."""
        return Truth(self)

    # Actions of instruments on the plant

    def install(self, node: str, head: LaserHead) -> None:
        """Install a vibrometer with the rig file's `head`, and wire its output to `node`."""
        self._put_up(head)
        self._nodes[node] = Output(partial(laser, head=head))
        self._noise[node] = self.rng(f"noise of {node}")

    def has_rtsi(self) -> bool:
        """Return True when a cable joins the cards' clocks."""
        there = [fault.rtsi(self.clock.now()) for fault in self.faults]
        return all(there)

    def switch(self, patch: str, closed: bool, at: float) -> None:
        """Switch a relay contact at `at` (s), or at the plant's present time if that is later."""
        with self._lock:
            for fault in self.faults:
                patch = fault.contact(patch, at)
            insort(self._switched, (max(at, self._now), len(self._switched), patch, closed))

    def wire(self, box: Switches) -> None:
        """Connect a box's contacts to the patches; each step to `until` first calls `box.take(until)`."""
        self._boxes.append(box)

    def drive(self, node: str, source: Source) -> None:
        """See `haploop.mocks.plant.Nodes.drive`. Only the amplifier's inputs have an effect."""
        with self._lock:
            self.advance(self.clock.now())
            if node in self._inputs:
                self._sources[node] = source

    # Reading by converters

    def read(self, nodes: Sequence[str], times: FloatArray) -> FloatArray:
        """See `haploop.mocks.plant.Nodes.read`. An unwired node carries 0 V."""
        with self._lock:
            volts = np.zeros(times.shape)
            if not times.size:
                return volts
            self.advance(float(times[:, -1].max()))
            if self.faults:
                times = self._clocked(nodes, times)
            wired = [row for row, node in enumerate(nodes) if node in self._nodes]
            for quantity, alike in groupby(wired, lambda row: self._nodes[nodes[row]].quantity):
                rows = list(alike)
                outputs = [self._nodes[nodes[row]].number for row in rows]
                noise = [self._noise[nodes[row]] for row in rows]
                volts[rows] = quantity(self, times[rows], outputs, noise)
            for fault in self.faults:
                for row, node in enumerate(nodes):
                    volts[row] = fault.channel(node, volts[row], times[row])
            return volts

    def _clocked(self, nodes: Sequence[str], times: FloatArray) -> FloatArray:
        """Return the rig's times, (nodes, times) s, at which the nodes' cards sample for `times`."""
        clocked = times.copy()
        for row, node in enumerate(nodes):
            card = self._cards.get(node)
            if card:
                for fault in self.faults:
                    fault.samples(card, float(times[row, -1]))
                clocked[row] -= self.lateness(card, times[row])
        return clocked

    def plays(self, device: str) -> None:
        """See `haploop.mocks.plant.Nodes.plays`."""
        for fault in self.faults:
            fault.plays(device, self.clock.now())

    def lateness(self, device: str, times: FloatArray) -> FloatArray:
        """Return the delay of a card's clock against the rig's, (times,) s."""
        late = np.zeros(len(times))
        for fault in self.faults:
            late += fault.lateness(device, times)
        return late

    # Stepping

    def advance(self, until: float) -> None:
        """Step to `until` (s), with contacts and output steps in order of time."""
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
                    together.setdefault(key, {})[node] = self._amplifier.output(run, self.faults)
        before = -np.inf
        for (start, period, count), driven in sorted(together.items(), key=lambda item: item[0]):
            if start < before:
                raise NotImplementedError(
                    "Outputs that play at the same time on different clocks are not simulated."
                )
            held = {node: np.full(count, v) for node, v in self._inputs.items()}
            self._apply(start, period, held | driven)
            before = start + (count - 1) * period
        self._now = max(self._now, until)

    def _apply(self, start: float, period: float, outputs: Mapping[str, FloatArray]) -> None:
        """Step the surface. `outputs` maps each amplifier input to its output, (steps,) V."""
        self._inputs.update({node: float(volts[-1]) for node, volts in outputs.items()})
        steps = len(next(iter(outputs.values()), ()))
        rest = np.zeros(steps)
        input_of = self._amplifier.inputs
        at: Mapping[str, FloatArray] = {
            p: outputs.get(input_of.get(p, ""), rest) if p in self.closed else rest
            for p in self.surface.patches
        }
        for fault in self.faults:
            at = fault.patches(at, start)
        if steps:
            self.step(start, period, at)
        for node, volts in outputs.items():
            closed = frozenset(p for p in self.closed if input_of.get(p) == node)
            if closed:
                self.peak = max(self.peak, float(np.abs(volts).max()))
            if self.amplifier_record is not None:
                self.amplifier_record.append(AmplifierOutput(start, period, volts, closed))
