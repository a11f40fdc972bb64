"""What counter inputs measure: values made from the edges at a counter's terminals.

A measurement of time (frequency, period, width) is complete at an edge, and its value is a number of ticks of
the counter's timebase. A count or a position has a value at any time. A counter whose own name ("Dev1/ctr0")
is wired to a node of a plant takes the node's value for its count: so an encoder of a rig file follows a
displacement.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from nidaqmx.constants import (
    AngleUnits,
    AngularVelocityUnits,
    CountDirection,
    CounterFrequencyMethod,
    Edge,
    EncoderType,
    TimeUnits,
    UsageTypeCI,
)

from ..base.arrays import FloatArray
from .channel import Channel, default_terminal, timebase_of
from .counters import INPUTS
from .errors import unserved
from .pulses import Transitions

U = UsageTypeCI


class Signals(Protocol):
    """What a meter asks of the terminals."""

    def watched(self, terminal: str, width: float) -> Callable[[float, float], Transitions]:
        """Return what looks at a terminal from time to time, behind a digital filter unless `width` is 0."""

    def level(self, terminal: str, when: float) -> bool:
        """Return the level at a terminal at a time (s) that has passed; low where nothing drives it."""

    def driven(self, terminal: str) -> bool:
        """Return True when something stands at a terminal."""

    def wired(self, device: str) -> bool:
        """Return True when something is connected to a PFI terminal of a device."""

    def node(self, channel: Channel) -> Callable[[FloatArray], FloatArray] | None:
        """Return what a plant says is the count of a channel's counter at times (s), or None."""


_COUNTS = (U.COUNT_EDGES.value, U.POSITION_ANGULAR_ENCODER.value, U.POSITION_LINEAR_ENCODER.value)
_PAIRS = (U.PULSE_FREQ.value, U.PULSE_TIME.value, U.PULSE_TICKS.value, U.DUTY_CYCLE.value)
_VELOCITIES = (U.VELOCITY_ANGULAR_ENCODER.value, U.VELOCITY_LINEAR_ENCODER.value)
_SILENT_HZ = 1e3
"""Rate of the samples of a simulated device's counter that nothing drives (Hz; NI's own come at once)."""
_TICKS = TimeUnits.TICKS.value
_WHOLE_TURN = {
    AngleUnits.DEGREES.value: 360.0,
    AngleUnits.RADIANS.value: 2 * np.pi,
    AngularVelocityUnits.RPM.value: 60.0,
    AngularVelocityUnits.RADIANS_PER_SECOND.value: 2 * np.pi,
    AngularVelocityUnits.DEGREES_PER_SECOND.value: 360.0,
}
"""One turn, or one turn a second, in NI's units."""


class Meter:
    """The measurement of one counter channel since its task was armed at `began` (s)."""

    def __init__(self, channel: Channel, signals: Signals, began: float, timebase_hz: float) -> None:
        self._channel, self._signals = channel, signals
        # An edge at the very start counts.
        self._seen = float(np.nextafter(began, -np.inf))
        self.began = began
        self._zero = 0.0
        if (node := signals.node(channel)) is not None:
            self._zero = float(np.floor(node(np.array([began]))[0]))
        self._hz = timebase_of(channel, timebase_hz)
        self._usage = int(channel.values["CI_MEAS_TYPE"])
        self._input = INPUTS[self._usage]
        self._edges: dict[str, tuple[list[float], list[bool]]] = {}
        self._first: dict[str, bool] = {}
        """Levels when it was armed, by role."""
        self._looks: dict[str, Callable[[float, float], Transitions]] = {}

    @property
    def counts(self) -> bool:
        """True when the measurement has a value at any time."""
        return self._usage in _COUNTS

    @property
    def silent(self) -> bool:
        """True when nothing drives the terminals of a simulated device: its data are 0, as NI's own are."""
        if not self._channel.device.simulated or self._signals.node(self._channel) is not None:
            return False
        return not any(map(self._signals.driven, self.terminals.values()))

    @property
    def terminals(self) -> dict[str, str]:
        """Terminals that are looked at, by the role that each plays."""
        return {role: self._terminal(*named) for role, named in self._named.items()}

    @property
    def _named(self) -> dict[str, tuple[str, str]]:
        """The property that names each terminal, and the counter's socket that it is by default, by role."""
        first = (self._input.term, str(self._input.at(self._channel.values)))
        own = {"first": first}
        if self._usage == U.PULSE_WIDTH_DIGITAL_TWO_EDGE_SEPARATION.value:
            own["second"] = ("CI_TWO_EDGE_SEP_SECOND_TERM", "gate")
        elif "ENCODER_A" in self._input.term:
            own["second"] = (self._input.term.replace("_A_", "_B_"), "aux")
            if self._channel.values.get("CI_ENCODER_Z_INDEX_ENABLE"):
                own["index"] = ("CI_ENCODER_Z_INPUT_TERM", "gate")
        elif self._channel.values.get("CI_COUNT_EDGES_DIR") == CountDirection.EXTERNAL_SOURCE.value:
            own["second"] = ("CI_COUNT_EDGES_DIR_TERM", "aux")
        return own

    def _terminal(self, name: str, socket: str) -> str:
        """Name of a terminal; empty for one that is not known, on a device to which nothing is connected."""
        asked = self._channel.values.get(name)
        found = self._channel.device.full(str(asked)) if asked else default_terminal(self._channel, socket)
        if found is None and self._signals.wired(self._channel.device.name):
            raise unserved(
                f"the twin does not know at which terminal {self._channel.name!r} of a "
                f"{self._channel.product.name} measures by default: set {name}."
            )
        return found or ""

    def advance(self, now: float) -> None:
        """Look at what happened until `now` (s)."""
        if now < self._seen:
            return
        for role, terminal in self.terminals.items():
            if role not in self._looks:
                self._first[role] = self._signals.level(terminal, self.began)
                width = self._channel.filter_width(self._named[role][0])
                self._looks[role] = self._signals.watched(terminal, width)
            found = self._looks[role](self._seen, now)
            times, levels = self._edges.setdefault(role, ([], []))
            times.extend(found.times.tolist())
            levels.extend(found.levels.tolist())
        self._seen = now

    def _transitions(self, role: str) -> Transitions:
        times, levels = self._edges.get(role, ([], []))
        return Transitions(np.array(times, np.float64), np.array(levels, np.bool_))

    def _level(self, role: str, times: FloatArray) -> Any:
        """Return the levels of a signal just before `times`: before its first change, as it was armed."""
        signal = self._transitions(role)
        levels = np.concatenate([[self._first.get(role, False)], signal.levels])
        return levels[np.searchsorted(signal.times, times, side="left")]

    def done(self, now: float) -> int:
        """Number of measurements that are complete at `now` (s)."""
        if self.silent:
            return int((now - self.began) * _SILENT_HZ) + 1
        self.advance(now)
        return len(self.events()[0])

    # Counts and positions

    def at(self, times: FloatArray) -> FloatArray:
        """Return the counts or positions at `times` (s), which must have been looked at."""
        values, node = self._channel.values, self._signals.node(self._channel)
        counted = None if node is None else np.floor(node(times)) - self._zero
        if self._usage == U.COUNT_EDGES.value:
            return self._edges_at(times) if counted is None else self._whole(counted)
        count = self._position(times) if counted is None else counted
        decoding = values.get("CI_ENCODER_DECODING_TYPE", EncoderType.X_1.value)
        per_pulse = {EncoderType.X_2.value: 2, EncoderType.X_4.value: 4}.get(decoding, 1)
        return self.placed(count / per_pulse if per_pulse > 1 else count, count)

    def placed(self, pulses: FloatArray, counts: FloatArray) -> FloatArray:
        """Bring an encoder's pulses, or pulses a second, into the channel's units.

        `counts` are those of its decoder.
        """
        values, units = self._channel.values, int(self._channel.values.get(self._input.units, 0))
        if units == _TICKS:
            return counts
        kind = "CI_VELOCITY" if self._usage in _VELOCITIES else "CI"
        if self._usage in (U.POSITION_LINEAR_ENCODER.value, U.VELOCITY_LINEAR_ENCODER.value):
            size = float(values.get(f"{kind}_LIN_ENCODER_DIST_PER_PULSE", 0.001))
            return np.asarray(values.get("CI_LIN_ENCODER_INITIAL_POS", 0.0) + pulses * size)
        turn = _WHOLE_TURN.get(units, 360.0) / float(values.get(f"{kind}_ANG_ENCODER_PULSES_PER_REV", 24))
        return np.asarray(values.get("CI_ANG_ENCODER_INITIAL_ANGLE", 0.0) + pulses * turn)

    def _edges_at(self, times: FloatArray) -> FloatArray:
        values = self._channel.values
        found = self._transitions("first")
        active = found.to(values.get(self._input.edge, Edge.RISING.value) == Edge.RISING.value)
        step = np.ones(len(active))
        way = values.get("CI_COUNT_EDGES_DIR", CountDirection.COUNT_UP.value)
        if way == CountDirection.COUNT_DOWN.value:
            step = -step
        elif way == CountDirection.EXTERNAL_SOURCE.value:
            step = np.where(self._level("second", active), 1.0, -1.0)
        total = np.concatenate([[0.0], np.cumsum(step)])
        return self._whole(total[np.searchsorted(active, times + 1e-12, side="right")])

    def _whole(self, counted: FloatArray) -> FloatArray:
        """Return a counter's register after `counted` edges."""
        initial = self._channel.values.get("CI_COUNT_EDGES_INITIAL_CNT", 0)
        return np.asarray((initial + counted) % 2.0**self._channel.product.counter_bits)

    def _position(self, times: FloatArray) -> FloatArray:
        """Counts of the encoder's decoder at `times`."""
        values = self._channel.values
        decoding = values.get("CI_ENCODER_DECODING_TYPE", EncoderType.X_1.value)
        a, b = self._transitions("first"), self._transitions("second")
        if decoding == EncoderType.TWO_PULSE_COUNTING.value:
            return np.asarray(
                np.searchsorted(a.to(True), times + 1e-12, side="right").astype(float)
                - np.searchsorted(b.to(True), times + 1e-12, side="right")
            )
        # A before B is forward: then B differs from A when A changes, and equals it when B changes.
        steps = [(a.times, np.where(self._level("second", a.times) == a.levels, -1.0, 1.0))]
        if decoding == EncoderType.X_4.value:
            steps.append((b.times, np.where(self._level("first", b.times) == b.levels, 1.0, -1.0)))
        elif decoding == EncoderType.X_1.value:
            # Counts up on rising, down on falling edges of A.
            forward = steps[0][1] > 0
            kept = forward == a.levels
            steps = [(a.times[kept], steps[0][1][kept])]
        when = np.concatenate([own for own, _ in steps])
        order = np.argsort(when, kind="stable")
        total = np.concatenate([[0.0], np.cumsum(np.concatenate([way for _, way in steps])[order])])
        return np.asarray(total[np.searchsorted(when[order], times + 1e-12, side="right")])

    # Measurements that are complete at an edge

    def events(self) -> tuple[FloatArray, FloatArray]:
        """Return the times (events,) s at which measurements were complete, and their values, (2, events).

        The second row is 0 unless a sample is a pair.
        """
        values, found = self._channel.values, self._transitions("first")
        rising = values.get(self._input.edge, Edge.RISING.value) == Edge.RISING.value
        if self._usage == U.PULSE_WIDTH_DIGITAL_SEMI_PERIOD.value:
            return self._spans(found.times[:-1], found.times[1:])
        if self._usage == U.PULSE_WIDTH_DIGITAL_TWO_EDGE_SEPARATION.value:
            second = values.get("CI_TWO_EDGE_SEP_SECOND_EDGE", Edge.RISING.value) == Edge.RISING.value
            return self._spans(*_followed(found.to(rising), self._transitions("second").to(second)))
        starts = found.to(rising)
        if self._usage == U.PULSE_WIDTH_DIGITAL.value:
            return self._spans(*_followed(starts, found.to(not rising)))
        if self._usage in _PAIRS:
            return self._pulse_pairs(starts, found.to(not rising), rising)
        return self._periods(starts)

    def _periods(self, starts: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = self._channel.values
        name = self._input.term.removesuffix("_TERM").replace("_INPUT", "")
        method = values.get(f"{name}_MEAS_METH")
        if method == CounterFrequencyMethod.HIGH_FREQUENCY_2_COUNTERS.value:
            window = float(values.get(f"{name}_MEAS_TIME") or 1e-3)
            windows = np.arange(1.0, int((self._seen - self.began) / window + 1e-9) + 1)
            ends: FloatArray = self.began + window * windows
            counted = np.diff(np.searchsorted(starts, np.concatenate([[self.began], ends])))
            spans = np.where(counted > 0, window / np.maximum(counted, 1), np.inf)
            return ends, self._reported(np.asarray(spans, dtype=np.float64))
        step = 1
        if method == CounterFrequencyMethod.LARGE_RANGE_2_COUNTERS.value:
            step = max(1, int(values.get(f"{name}_DIV") or 4))
        chosen = starts[::step]
        times, spans = self._ticks(chosen[:-1], chosen[1:])
        return times, self._reported(spans / step)

    def _spans(self, starts: FloatArray, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
        times, spans = self._ticks(starts, ends)
        return times, self._reported(spans)

    def _ticks(self, starts: FloatArray, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `ends`, and the spans as the timebase counts them (s)."""
        ticks = np.rint(ends * self._hz) - np.rint(starts * self._hz)
        return ends, np.asarray(np.maximum(ticks, 1) / self._hz)

    def _reported(self, spans: FloatArray) -> FloatArray:
        """Bring spans (s) into the channel's units, (2, events)."""
        ticks = self._channel.values.get(self._input.units) == _TICKS
        if ticks:
            values = spans * self._hz
        elif self._usage == U.FREQUENCY.value:
            values = 1 / spans
        elif self._usage in _VELOCITIES:
            values = self.placed(1 / spans, 1 / spans)
        else:
            values = spans
        return np.array([values, np.zeros(len(values))])

    def _pulse_pairs(
        self, starts: FloatArray, middles: FloatArray, rising: bool
    ) -> tuple[FloatArray, FloatArray]:
        begins, ends = starts[:-1], starts[1:]
        index = np.searchsorted(middles, begins, side="right")
        middle = middles[np.minimum(index, len(middles) - 1)] if len(middles) else begins
        times, first = self._ticks(begins, middle)
        times, second = self._ticks(middle, ends)
        high, low = (first, second) if rising else (second, first)
        if self._usage == U.PULSE_TICKS.value:
            pair = np.array([high * self._hz, low * self._hz])
        elif self._usage == U.PULSE_TIME.value:
            scale = self._hz if self._channel.values.get(self._input.units) == _TICKS else 1.0
            pair = np.array([high, low]) * scale
        elif self._usage == U.DUTY_CYCLE.value:
            pair = np.array([high / (high + low), np.zeros(len(high))])
        else:
            pair = np.array([1 / (high + low), high / (high + low)])
        return times, pair


def _followed(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pair each of `first` with the next of `second`; one that is followed by another first is left out."""
    if not len(first) or not len(second):
        return np.zeros(0), np.zeros(0)
    index = np.searchsorted(second, first, side="right")
    following = np.append(first[1:], np.inf)
    kept = index < len(second)
    kept[kept] &= second[index[kept]] <= following[kept]
    return first[kept], second[index[kept]]
