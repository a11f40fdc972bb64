"""The plant: the simulated physical world of one rig, as nodes that carry a voltage.

Simulated parts interact only through the plant. Nodes have the names that the rig file gives to DAQ
channels and outputs. Time is the rig's clock; the plant steps only as far as a call requires.
"""

from __future__ import annotations

import math
from bisect import insort
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby

import numpy as np

from ...base.arrays import FloatArray
from ...base.clock import Clock
from ...base.errors import ConfigurationError
from ...instruments.config import RigFile
from ...nidaqmx_twin.nodes import Called, Run, Signal, Source
from .places import LaserHead, OnAmplifier, OnCards, OnRelay, OnSurface, Switches
from .scene import AmplifierOutput, Scene, Truth
from .sensed import Output, Quantity, laser, signalled, wired
from .surface import PlantSource

AMPLIFIER_GAIN, AMPLIFIER_GAIN_ERROR = 50.0, 0.01
"""Gain of an E-413.D2 (V per V) and its relative tolerance (docs/hardware.md, "Amplifier")."""
AMPLIFIER_LOW, AMPLIFIER_HIGH = -100.0, 400.0
"""Rails of its output (V; docs/hardware.md, "Amplifier")."""
_DESCRIBED = "analog-amplifier"
"""Driver of an amplifier whose figures are the rig file's; of any other they are those of the E-413.D2."""


class Amplifier:
    """The amplifier of a rig. `inputs` maps each patch to the node that drives it."""

    def __init__(self, file: RigFile, patches: Sequence[str], rng: np.random.Generator) -> None:
        self._tolerance = 1 + AMPLIFIER_GAIN_ERROR * rng.uniform(-1, 1)
        told = file.amplifier.settings if file.amplifier else {}
        described = file.amplifier is not None and file.amplifier.driver == _DESCRIBED
        gain = float(told["gain"]) if described else AMPLIFIER_GAIN
        self._gain = -gain if described and told.get("inverting") else gain
        self._low = float(told["min"]) if described else AMPLIFIER_LOW
        self._high = float(told["max"]) if described else AMPLIFIER_HIGH
        named = told.get("input")
        if isinstance(named, dict):
            self.inputs = {str(patch): str(node) for patch, node in named.items()}
        else:
            self.inputs = dict.fromkeys(patches, str(named)) if named else {}

    def output(self, run: Run, faults: Sequence[OnAmplifier]) -> FloatArray:
        """Return the output (steps,) V for a run of an input."""
        gain = self._gain
        for fault in faults:
            gain = fault.gain(gain, run)
        volts = np.clip(run.values * (gain * self._tolerance), self._low, self._high)
        for fault in faults:
            volts = fault.output(volts, run.times)
        return np.asarray(volts)


_Place = tuple[str, type]
"""A node, and the kind of source that drives it."""
_Reading = tuple[slice | list[int], Quantity, list[int], list[np.random.Generator]]
"""Rows of the nodes that one sensor's outputs are wired to, the sensor, its outputs and their noise."""


@dataclass(frozen=True, eq=False)
class _Group:
    """Runs that begin together, on one clock and of one length: (steps,) V of each."""

    start: float
    period: float
    played: Mapping[_Place, FloatArray]

    @property
    def count(self) -> int:
        return len(next(iter(self.played.values())))

    @property
    def end(self) -> float:
        """The time of the last step (s)."""
        return self.start + (self.count - 1) * self.period if self.count > 1 else self.start


class Plant(Scene):
    """The simulated world of one rig. A laser measures once a vibrometer's twin has installed its head."""

    def __init__(self, file: RigFile, clock: Clock, source: PlantSource | None = None) -> None:
        super().__init__(file, clock, source)
        self._switched: list[tuple[float, int, str, bool]] = []
        self._boxes: list[Switches] = []
        self._called: list[Called] = []
        self._sources: dict[_Place, Source] = {}
        self._last: dict[_Place, float] = {}
        """V that each source holds until its next run."""
        self._now = clock.now()
        self._amplifier = Amplifier(file, self.section.patches, self.rng("amplifier"))
        self._inputs = dict.fromkeys(self._amplifier.inputs.values(), 0.0)
        self._cards: dict[str, str] = {}
        self.cables: dict[str, str] = {}
        """Outputs that somebody has plugged into channels, by the channel's name; a twin reads what they
        say."""
        self._nodes = wired(self)
        self._noise = {node: self.rng(f"noise of {node}") for node in self._nodes}
        self._read: dict[tuple[str, ...], list[_Reading]] = {}
        """How the nodes of a card are read together."""

    @property
    def truth(self) -> Truth:
        """See `Truth`."""
        return Truth(self)

    # Actions of instruments on the plant

    def install(self, node: str, head: LaserHead) -> None:
        """Install a vibrometer with the rig file's `head`, and wire its output to `node`."""
        self._put_up(head)
        self._show(node, partial(laser, head=head))

    def connect(self, node: str, signal: Signal) -> None:
        """Connect an instrument's output to a channel of the DAQ, in place of what was wired to it.

        `signal` returns the volts of the output, see `Signal`. It may ask the plant: `force` is the finger's,
        `seen` the surface's velocity where the laser is aimed, and `rng(name)` a generator of noise.
        Raises ConfigurationError for a channel that [daq.channels] does not have.
        """
        channels = self.file.daq.settings.get("channels")
        along = self.file.adc.settings.get("channels", {}) if self.file.adc is not None else {}
        if isinstance(channels, dict) and node not in channels and node not in along:
            raise ConfigurationError(
                f"A twin puts a signal on the channel {node!r}, and [daq.channels] of {self.file.name} has "
                f"{', '.join(channels)}: name one of them."
            )
        self._show(node, partial(signalled, signal=signal))

    def _show(self, node: str, quantity: Quantity) -> None:
        with self._lock:
            self._nodes[node] = Output(quantity)
            self._noise[node] = self.rng(f"noise of {node}")
            self._read.clear()

    def sample_by(self, node: str, card: str) -> None:
        """Say that a card samples a node: faults of cards act on the nodes of theirs."""
        self._cards[node] = card

    def has_rtsi(self) -> bool:
        """Return True when a cable joins the cards' clocks."""
        there = [fault.rtsi(self.clock.now()) for fault in self.faults.at(OnCards)]
        return all(there)

    def switch(self, patch: str, closed: bool, at: float) -> None:
        """Switch a relay contact at `at` (s), or at the plant's present time if that is later."""
        with self._lock:
            for fault in self.faults.at(OnRelay):
                patch = fault.contact(patch, at)
            insort(self._switched, (max(at, self._now), len(self._switched), patch, closed))

    def wire(self, box: Switches) -> None:
        """Connect a box's contacts to the patches; each step to `until` first calls `box.take(until)`."""
        self._boxes.append(box)

    def begin(self, card: Called) -> None:
        """Call a card from now on before each step: whoever reads, its outputs are known up to then."""
        with self._lock:
            self._called.append(card)

    def end(self, card: Called, then: Callable[[float], None]) -> None:
        """Call a card up to now for the last time, and `then` with the time (s), before anybody steps."""
        with self._lock:
            now = self.clock.now()
            self.advance(now)
            self._called.remove(card)
            then(now)

    def drive(self, node: str, source: Source) -> None:
        """See `haploop.nidaqmx_twin.nodes.Nodes.drive`. Only the amplifier's inputs have an effect.

        The sources of a node add up; one of the same kind takes the place of the one before.
        """
        with self._lock:
            self.advance(self.clock.now())
            if node in self._inputs:
                self._sources[node, type(source)] = source
                self._last.setdefault((node, type(source)), 0.0)

    # Reading by converters

    def read(self, nodes: Sequence[str], times: FloatArray) -> FloatArray:
        """See `haploop.nidaqmx_twin.nodes.Nodes.read`. An unwired node carries 0 V."""
        with self._lock:
            volts = np.zeros(times.shape)
            if not times.size:
                return volts
            self.advance(float(times[:, -1].max()))
            if self.faults.at(OnCards):
                times = self._clocked(nodes, times)
            together = self._read.get(tuple(nodes))
            if together is None:
                together = self._read[tuple(nodes)] = self._readings(nodes)
            for rows, quantity, outputs, noise in together:
                volts[rows] = quantity(self, times[rows], outputs, noise)
            for fault in self.faults.at(OnCards):
                for row, node in enumerate(nodes):
                    volts[row] = fault.channel(node, volts[row], times[row])
                fault.scanned(nodes, volts, times)
            return volts

    def _readings(self, nodes: Sequence[str]) -> list[_Reading]:
        """Return how nodes are read: those of a sensor that follow one another in one call."""
        readings: list[_Reading] = []
        wired = [row for row, node in enumerate(nodes) if node in self._nodes]
        for quantity, alike in groupby(wired, lambda row: self._nodes[nodes[row]].quantity):
            rows = list(alike)
            outputs = [self._nodes[nodes[row]].number for row in rows]
            noise = [self._noise[nodes[row]] for row in rows]
            # A slice of the times is a view of them; nodes without a wire may lie between.
            one = rows[-1] - rows[0] + 1 == len(rows)
            readings.append((slice(rows[0], rows[-1] + 1) if one else rows, quantity, outputs, noise))
        return readings

    def _clocked(self, nodes: Sequence[str], times: FloatArray) -> FloatArray:
        """Return the rig's times, (nodes, times) s, at which the nodes' cards sample for `times`."""
        clocked = times.copy()
        for row, node in enumerate(nodes):
            card = self._cards.get(node)
            if card:
                for fault in self.faults.at(OnCards):
                    fault.samples(card, float(times[row, -1]))
                clocked[row] -= self.lateness(card, times[row])
        return clocked

    def plays(self, device: str) -> None:
        """See `haploop.nidaqmx_twin.nodes.Nodes.plays`."""
        for fault in self.faults.at(OnCards):
            fault.plays(device, self.clock.now())

    def lateness(self, device: str, times: FloatArray) -> FloatArray:
        """Return the delay of a card's clock against the rig's, (times,) s."""
        late = np.zeros(len(times))
        for fault in self.faults.at(OnCards):
            late += fault.lateness(device, times)
        return late

    # Stepping

    def advance(self, until: float) -> None:
        """Step to `until` (s), with contacts and output steps in order of time."""
        with self._lock:
            for card in self._called:
                card.call(until)
            if until <= self._now:
                return
            for box in self._boxes:
                for patch, closed, at in box.take(until):
                    self.switch(patch, closed, at)
            while (at := self._next_change()) <= until:
                self._step_to(at)
                if self._switched and self._switched[0][0] <= at:
                    _, _, patch, closed = self._switched.pop(0)
                    self.closed ^= {patch} if closed is not (patch in self.closed) else set()
                else:
                    self._change_hand(min(self.hands, key=lambda hand: hand.due))
                self._apply(at, np.inf, {node: np.array([v]) for node, v in self._inputs.items()})
            self._step_to(until)

    def _next_change(self) -> float:
        """Time (s) of the next contact that switches or hand that changes; infinite without one."""
        due = [hand.due for hand in self.hands]
        if self._switched:
            due.append(self._switched[0][0])
        return min(due, default=math.inf)

    def _step_to(self, until: float) -> None:
        together: dict[tuple[float, float, int], dict[_Place, FloatArray]] = {}
        for place, source in self._sources.items():
            for run in source.take(until):
                if len(run.values):
                    together.setdefault((run.start, run.period, len(run.values)), {})[place] = run.values
        # Of steps at one instant, such as zero and the beginning of a play, the last to come holds.
        groups = deque(
            _Group(*key[:2], played) for key, played in sorted(together.items(), key=lambda i: i[0][0])
        )
        while groups:
            group = groups.popleft()
            at_once, end = [group], group.end
            while groups and groups[0].start < end:
                at_once.append(groups.popleft())
                end = max(end, at_once[-1].end)
            self._play(group if len(at_once) == 1 else _on_one_clock(at_once, self._last))
        self._now = max(self._now, until)

    def _play(self, group: _Group) -> None:
        """Step the surface with what the sources of each node add up to."""
        self._last |= {place: float(values[-1]) for place, values in group.played.items()}
        count = group.count
        outputs = {node: np.full(count, v) for node, v in self._inputs.items()}
        for node in {node for node, _ in group.played}:
            own = [place for place in self._last if place[0] == node]
            added = sum(group.played.get(place, np.full(count, self._last[place])) for place in own)
            run = Run(group.start, group.period, np.asarray(added), node)
            outputs[node] = self._amplifier.output(run, self.faults.at(OnAmplifier))
        self._apply(group.start, group.period, outputs)

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
        for fault in self.faults.at(OnSurface):
            at = fault.patches(at, start)
        if steps:
            self.step(start, period, at)
        for node, volts in outputs.items():
            closed = frozenset(p for p in self.closed if input_of.get(p) == node)
            if closed:
                self.peak = max(self.peak, float(np.abs(volts).max()))
            if self.amplifier_record is not None:
                self.amplifier_record.append(AmplifierOutput(start, period, volts, closed))


def _on_one_clock(groups: Sequence[_Group], held: Mapping[_Place, float]) -> _Group:
    """Runs that overlap, as one group on the clock of the fastest; the others are up to a period off."""
    fastest = min(groups, key=lambda group: group.period)
    period, end = fastest.period, max(group.end for group in groups)
    first = math.ceil((groups[0].start - fastest.start) / period)
    times = fastest.start + period * np.arange(first, math.floor((end - fastest.start) / period) + 1)
    played: dict[_Place, FloatArray] = {}
    for group in groups:
        steps = Run(group.start, group.period, np.zeros(group.count)).times
        # A time of the clock itself is not missed for rounding.
        index = np.searchsorted(steps, times + 1e-3 * period, side="right") - 1
        for place, values in group.played.items():
            before = played.get(place, np.full(len(times), held[place]))
            played[place] = np.where(index < 0, before, values[index])
            played[place][-1] = values[-1]  # also when it came after the clock's last time
    return _Group(float(times[0]), period, played)
