"""What tasks do with digital signals: pulses that they put out, measurements, and reference triggers."""

from __future__ import annotations

import re

import numpy as np
from nidaqmx.constants import Edge, Level, TriggerType

from ....instruments.arrays import FloatArray
from .channel import Channel, counter_timebase
from .counting import Meter
from .devices import Inventory
from .looking import Terminals
from .pulses import PulseTrain
from .tasks import Task

_GLIMPSE = 1e-3
"""Interval at which a signal that somebody waits for is looked at (s)."""


def begin_pulses(terminals: Terminals, task: Task, regenerates: bool, now: float) -> None:
    """Begin the pulses of a task of counter outputs, whose buffer ends or `regenerates`."""
    for row, channel in enumerate(task.channels):
        high, low = (np.array([part]) for part in channel.pulse)
        total = task.total if task.timed else 1
        if task.pulses is not None:
            high, low = (part[row] for part in task.pulses)
            if task.timed and not regenerates:
                total = len(high)
        idle = channel.values.get("CO_PULSE_IDLE_STATE") == Level.HIGH.value
        train = PulseTrain(now + channel.pulse_delay, high, low, total, idle)
        task.trains.append(train)
        terminals.drive(_output_of(channel), train)
    task.clock.start = task.trains[0].start


def change_pulses(
    terminals: Terminals, task: Task, now: float, pulses: tuple[FloatArray, FloatArray]
) -> None:
    """Let a running task continue with other pulses, (channels, pulses) s high and low, after this one."""
    high, low = pulses
    for row, (channel, train) in enumerate(zip(task.channels, list(task.trains), strict=True)):
        follower = PulseTrain(train.next_end(now), high[row], low[row], None, train.idle)
        task.trains[row] = follower
        terminals.drive(_output_of(channel), follower)


def _output_of(channel: Channel) -> str:
    home = channel.device.chassis or channel.device.name
    return f"/{home}/Ctr{re.sub(r'[^0-9]', '', channel.physical[0])}InternalOutput"


def begin_measuring(terminals: Terminals, task: Task, now: float) -> None:
    """Arm the counter inputs of a task."""
    task.meters = [
        Meter(channel, terminals, now, counter_timebase(channel.device.product.family))
        for channel in task.channels
    ]


def reference_terminal(inventory: Inventory, terminals: Terminals, task: Task) -> str | None:
    """Return the terminal of a task's digital reference trigger if something can come there, else None."""
    source = task.setting("Trig", "DIG_EDGE_REF_TRIG_SRC")
    if not source or task.setting("Trig", "REF_TRIG_TYPE") != TriggerType.DIGITAL_EDGE.value:
        return None
    terminal = inventory.terminal(task.device, source)
    return terminal if terminals.driven(terminal) or not task.device.simulated else None


def glimpse(inventory: Inventory, terminals: Terminals, task: Task, now: float) -> float | None:
    """Time to look again at a task whose next sample the signals decide (s); None for another."""
    if task.pretrigger is not None and task.reference is None and task.clock.start is not None:
        source = reference_terminal(inventory, terminals, task)
        _look_for_reference(terminals, source or "", task, now)
    return now + _GLIMPSE if task.waits() else None


def _look_for_reference(terminals: Terminals, source: str, task: Task, now: float) -> None:
    rate_hz, start = task.clock.rate_hz, task.clock.start or 0.0
    first = start + (task.pretrigger or 0) / rate_hz
    rising = task.setting("Trig", "DIG_EDGE_REF_TRIG_EDGE", Edge.RISING.value) == Edge.RISING.value
    found = terminals.look(source, first, now).to(rising)
    if len(found):
        task.reference = int(np.ceil((found[0] - start) * rate_hz - 1e-6))
