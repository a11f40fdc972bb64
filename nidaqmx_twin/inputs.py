"""Signals at input terminals: from the plant if wired, else those of NI's simulated devices."""

from __future__ import annotations

from typing import Any

import numpy as np
from nidaqmx.constants import Edge
from nidaqmx.error_codes import DAQmxErrors

from ..base.arrays import BoolArray, FloatArray
from .channel import Channel
from .converter import LOST, convert
from .errors import DaqmxError
from .nodes import SamplesLost
from .system import NiSystem
from .tasks import Chunk, Task

_SINE_PERIOD = 100
"""Samples per period of the sine at an unwired analog input."""
_HIGH = 0.5
"""Level above which a digital input that is set reads 1, be it set in 0 and 1 or in volts."""
_SINE_PART, _SINE_NOISE = 0.6, 0.02
"""Amplitudes of that sine and its noise, as fractions of half the range; the sum stays below 1 to avoid
clipping."""


def samples(system: NiSystem, task: Task, first: int, count: int) -> Any:
    """Return the samples [first, first + count) of a clocked input, which must have been acquired.

    Returns (channels, count) float64 V, or (lines, count) bool. Samples are made once and in order, so
    that noise does not depend on the division into reads, and are kept as long as the program's buffer
    keeps them.
    """
    if first + count > task.made:
        chunk = Chunk(task.made, _make(system, task, task.made, first + count - task.made))
        task.made = first + count
        task.chunks.append(chunk)
    oldest = task.made - max(task.buffer_size, count)
    while len(task.chunks) > 1 and task.chunks[1].first <= min(oldest, first):
        task.chunks.popleft()
    parts = [
        chunk.samples[:, max(0, first - chunk.first) : first + count - chunk.first]
        for chunk in task.chunks
        if chunk.first < first + count and chunk.first + chunk.samples.shape[1] > first
    ]
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


def acquire(system: NiSystem, task: Task, count: int) -> Any:
    """Take `count` software-timed samples now. Shapes as in `samples`."""
    now = system.clock.now()
    first = task.on_demand
    if task.kind == "ci":
        return _counted(task, np.full(count, now))
    if task.is_input:
        task.on_demand += count
    if task.kind == "ai":
        # Counted for the card: a new task does not read the noise of the last one again.
        first = system.polled[task.device.name]
        system.polled[task.device.name] += count
    times = np.full(count, now)
    index = np.arange(first, first + count)
    if task.kind in ("di", "do"):
        return _lines(system, task, times, index)
    volts, driven = _volts(system, task, [times] * len(task.channels), index)
    noise = {d.name: np.random.default_rng([system.seed, 1, first]) for d in task.devices}
    return _converted(task, volts, driven, noise)


def _make(system: NiSystem, task: Task, first: int, count: int) -> Any:
    index = np.arange(first, first + count)
    index = index + task.base
    if task.kind == "ci" and task.implicit:
        return _measured(task, index, system.clock.now())
    clock = task.clock
    assert clock.start is not None, "samples exist only after the start"
    edges = clock.start + (task.offset + index) / clock.rate_hz
    if task.edges is not None:
        edges = task.edges.times[index]
    elif (
        task.shares is not None
        and task.setting("Timing", "SAMP_CLK_ACTIVE_EDGE", Edge.RISING.value) == Edge.FALLING.value
    ):
        edges = edges + 0.5 / clock.rate_hz
    now = system.clock.now()
    if task.kind == "ci":
        return _counted(task, np.minimum(edges, now))
    if task.kind == "di":
        return _lines(system, task, np.minimum(edges, now), index)
    times = [np.minimum(edges + task.delay(i), now) for i in range(len(task.channels))]
    volts, driven = _volts(system, task, times, index)
    return _converted(task, volts, driven, task.noise)


def _counted(task: Task, times: FloatArray) -> FloatArray:
    """What counters show at `times` (s): (2 rows a channel, times); of times measured, the last."""
    rows = np.zeros((2 * len(task.meters), len(times)))
    for place, meter in enumerate(task.meters):
        if meter.silent:
            continue
        meter.advance(float(times[-1]))
        if meter.counts:
            rows[2 * place] = meter.at(times)
            continue
        ends, values = meter.events()
        last = np.searchsorted(ends, times + 1e-12, side="right") - 1
        known = last >= 0
        rows[2 * place : 2 * place + 2, known] = values[:, last[known]]
    return rows


def _measured(task: Task, index: Any, now: float) -> FloatArray:
    """The measurements `index` of counters that the signal itself times, (2 rows a channel, measurements)."""
    rows = np.zeros((2 * len(task.meters), len(index)))
    for place, meter in enumerate(task.meters):
        if meter.silent:
            continue
        meter.advance(now)
        rows[2 * place : 2 * place + 2] = (
            [meter.at(np.full(len(index), now)), np.zeros(len(index))]
            if meter.counts
            else meter.events()[1][:, index]
        )
    return rows


def _volts(system: NiSystem, task: Task, times: list[FloatArray], index: Any) -> tuple[FloatArray, BoolArray]:
    """Return the true volts at the terminals, (channels, samples), and True where a channel is driven."""
    volts = np.empty((len(task.channels), len(index)))
    driven = np.ones(len(task.channels), dtype=np.bool_)
    rows, nodes, ends = [], [], []
    for row, channel in enumerate(task.channels):
        name = channel.physical[0]
        if len(channel.physical) > 1:
            driven[row] = False
            volts[row] = _power(system, channel, times[row], _sine(channel, row, index))
            continue
        node = system.wiring.get(f"{channel.device.name}/{name}")
        if name.startswith("_ao"):
            output = f"{channel.device.name}/{name[1:].split('_')[0]}"
            volts[row] = system.outputs[output].at(times[row])
        elif node is not None and system.nodes is not None:
            rows.append(row)
            nodes.append(node)
            ends += [(row, system.wiring[end]) for end in [channel.negative] if end in system.wiring]
        else:
            driven[row] = False
            volts[row] = _sine(channel, row, index)
    if system.nodes is not None and rows:
        try:
            volts[rows] = system.nodes.read(nodes, np.array([times[row] for row in rows]))
            for row, node in ends:
                volts[row] -= system.nodes.read([node], times[row][np.newaxis])[0]
        except SamplesLost as lost:
            raise DaqmxError(DAQmxErrors(LOST[lost.how]), str(lost), read=0) from None
    return volts, driven


def _power(system: NiSystem, channel: Channel, times: FloatArray, undriven: FloatArray) -> FloatArray:
    """Return the power (W) of the volts at a channel's first input and at the shunt on its second."""
    nodes = [system.wiring.get(f"{channel.device.name}/{name}") for name in channel.physical]
    shunt = channel.values.get("AI_CURRENT_SHUNT_RESISTANCE")
    if system.nodes is None or not shunt or any(node is None for node in nodes):
        return undriven
    volts, dropped = system.nodes.read([str(node) for node in nodes], np.array([times, times]))
    return np.asarray(volts * dropped / shunt)


def _sine(channel: Channel, row: int, index: Any) -> FloatArray:
    low, high = channel.volts
    middle, half = (high + low) / 2, (high - low) / 2
    phase = 2 * np.pi * (index / _SINE_PERIOD + row / 8)
    # The noise depends on the index alone, and so not on the division into reads.
    noise = 2 * np.modf(np.abs(np.sin((index + 1) * 12.9898 + row * 78.233)) * 43758.5453)[0] - 1
    return np.asarray(middle + half * (_SINE_PART * np.sin(phase) + _SINE_NOISE * noise))


def _converted(
    task: Task, volts: FloatArray, driven: BoolArray, noise: dict[str, np.random.Generator]
) -> FloatArray:
    result = np.empty_like(volts)
    for device in task.devices:
        rows = [i for i, channel in enumerate(task.channels) if channel.device == device]
        full_scale = np.array([task.channels[i].full_scale for i in rows])
        values, overload = convert(volts[rows], full_scale, device.product, noise[device.name])
        result[rows] = values
        over = overload & driven[rows]
        task.overloaded += [task.channels[rows[i]].name for i in np.flatnonzero(over)]
    for row in np.flatnonzero(~driven):
        width = task.channels[row].width
        result[row] = np.rint(volts[row] / width) * width
    return result


def _lines(system: NiSystem, task: Task, times: FloatArray, index: Any) -> BoolArray:
    states: list[Any] = []
    for channel in task.channels:
        first = len(states)
        for line in channel.physical:
            name = f"{channel.device.name}/{line}"
            output = system.outputs[name]
            if name in system.wiring and system.nodes is not None:
                states.append(system.nodes.read([system.wiring[name]], times[np.newaxis])[0] > _HIGH)
                continue
            if channel.device.simulated and not system.is_driven(channel.device, line):
                # NI's simulated lines count in binary, in groups of eight.
                states.append((index >> (int(line.rsplit("line", 1)[1]) % 8)) & 1 == 1)
            else:
                states.append(output.at(times) > 0.5)
        if channel.values.get(f"{channel.kind.upper()}_INVERT_LINES"):
            states[first:] = [~state for state in states[first:]]
    return np.array(states, dtype=np.bool_).reshape(-1, len(index))
