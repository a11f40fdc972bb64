"""Properties of counter channels that their state decides, and the terminals that they have by default."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from nidaqmx.constants import Level

from .channel import Channel, counter_timebase, default_terminal, timebase_of
from .counters import INPUTS
from .signalling import pulse_terminal
from .system import NiSystem
from .tasks import Task


def socket_of(channel: Channel, name: str) -> str | None:
    """Return the default terminal of the input that property `name` is about; None if it is not known."""
    own = INPUTS.get(int(channel.values.get("CI_MEAS_TYPE", 0)))
    if own is not None and name == own.term:
        return default_terminal(channel, own.at(channel.values))
    if "_B_INPUT" in name or name.endswith(("DIR_TERM", "SEP_FIRST_TERM")):
        return default_terminal(channel, "aux")
    if "_Z_INPUT" in name or name.endswith(("SEP_SECOND_TERM", "GATE_TERM")):
        return default_terminal(channel, "gate")
    return default_terminal(channel, "source") if name.endswith("_TERM") else None


def _count(system: NiSystem, task: Task, channel: Channel) -> int:
    if not task.meters:
        return int(channel.values.get("CI_COUNT_EDGES_INITIAL_CNT", 0))
    meter, now = task.meters[task.channels.index(channel)], system.clock.now()
    if meter.silent or not meter.counts:
        return 0
    meter.advance(now)
    return int(meter.at(np.array([now]))[0])


def _is_done(system: NiSystem, task: Task, channel: Channel) -> bool:
    return task.done(system.clock.now())


def _state(system: NiSystem, task: Task, channel: Channel) -> int:
    idle = channel.values.get("CO_PULSE_IDLE_STATE", Level.LOW.value) == Level.HIGH.value
    level = idle
    if task.trains:
        train, now = task.trains[task.channels.index(channel)], system.clock.now()
        changes = train.transitions(now - 2 * train.cycle, now)
        level = bool(changes.levels[-1]) if len(changes.levels) else idle
    return int((Level.HIGH if level else Level.LOW).value)


def _timebase(system: NiSystem, task: Task, channel: Channel) -> float:
    return timebase_of(channel, counter_timebase(channel.product.family))


COUNTER_FACTS: dict[str, Callable[[NiSystem, Task, Channel], Any]] = {
    "CI_COUNT": _count,
    "CI_CTR_TIMEBASE_RATE": _timebase,
    "CO_CTR_TIMEBASE_RATE": _timebase,
    "CO_PULSE_DONE": _is_done,
    "CO_OUTPUT_STATE": _state,
    "CO_COUNT": lambda s, t, ch: t.count(s.clock.now()),
    "CO_PULSE_TERM": lambda s, t, ch: pulse_terminal(ch),
    "CO_RDY_FOR_NEW_VAL": lambda s, t, ch: True,
}
"""Properties by NI's names."""
