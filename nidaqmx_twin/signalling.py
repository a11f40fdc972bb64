"""What tasks do with digital signals: pulses that they put out, measurements, clocks and triggers."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import partial

import numpy as np
from nidaqmx.constants import Edge, Level, TriggerType

from ..base.arrays import FloatArray
from .channel import Channel, counter_timebase, filter_width
from .counting import Meter
from .devices import Inventory, NiDevice
from .errors import DaqmxError, DAQmxErrors, unserved
from .pulses import PulseTrain, TriggeredTrain
from .tasks import Task
from .terminals import Bursts, Edges, Terminals

GLIMPSE = 1e-3
"""Interval at which a signal that somebody waits for is looked at (s)."""
_SIGNAL = re.compile(r"/(?P<device>[^/]+)/((ai|ao|di|do)/(SampleClock|StartTrigger)|Ctr\d+InternalOutput)")
_PULSES_AT = {"X Series": 12, "M Series": 12}
"""Number of the PFI terminal at which counter 0 puts out its pulses, by family (X Series manual 370784, and M
Series manual 371022, "Default Counter/Timer Pinouts"; counter n is at the nth after it)."""
_EXPORTED = {
    "SAMP_CLK": "{kind}/SampleClock",
    "START_TRIG": "{kind}/StartTrigger",
    "20_MHZ_TIMEBASE": "20MHzTimebase",
    "CTR_OUT_EVENT": "Ctr{number}InternalOutput",
    "CHANGE_DETECT_EVENT": "ChangeDetectionEvent",
}
"""Signals that a task can export, and the terminal inside its device at which each stands."""
_OF_TASKS = re.compile(r"/(SampleClock|StartTrigger|Ctr\d+InternalOutput)$")
"""Terminals that tasks drive, for which a task waits until the other one runs."""


def sources(inventory: Inventory, rtsi: bool, task: Task) -> tuple[str | None, set[str]]:
    """Return the terminal of the other task whose sample clock this one uses, and its triggers.

    A signal from outside the simulated devices is present at once, as on NI's simulated devices.
    """
    shares = None
    source = task.setting("Timing", "SAMP_CLK_SRC", "")
    if task.timed and source:
        shares = _signal(inventory, rtsi, task, inventory.terminal(task.device, source))
    triggers = set()
    for which in () if task.retriggered else ("START", "ARM_START"):
        if task.setting("Trig", f"{which}_TRIG_TYPE") == TriggerType.DIGITAL_EDGE.value:
            text = task.setting("Trig", f"DIG_EDGE_{which}_TRIG_SRC", "")
            terminal = inventory.terminal(task.device, text) if text else ""
            if terminal in task.emits and terminal.endswith("StartTrigger"):
                raise DaqmxError(
                    DAQmxErrors.ROUTE_SRC_AND_DEST_SAME_ROUTING,
                    "An attempt has been made to perform a route when the source and the destination are the "
                    f"same terminal: {terminal}.",
                )
            trigger = _signal(inventory, rtsi, task, terminal) if terminal else None
            if trigger is not None:
                triggers.add(trigger)
    return shares, triggers


def _signal(inventory: Inventory, rtsi: bool, task: Task, terminal: str) -> str | None:
    """Return `terminal` if another task must drive it, else None. Raises DaqmxError without a route."""
    match = _SIGNAL.fullmatch(terminal)
    if match is None or terminal in task.emits:
        return None
    source = inventory.device(match["device"])
    if not rtsi and not inventory.routed(source, task.device):
        raise DaqmxError(
            DAQmxErrors.TRIG_LINE_NOT_FOUND_ROUTING,
            f"No registered trigger lines could be found between the devices in the route from "
            f"{terminal} to {task.device.name}: if they are connected by a RTSI cable, register it.",
        )
    return terminal


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
        if task.trigger is not None:
            again = channel.values.get("CO_ENABLE_INITIAL_DELAY_ON_RETRIGGER", False)
            delays = (channel.pulse_delay, channel.pulse_delay if again else 0.0)
            train = TriggeredTrain(now, high, low, total, idle, triggers=task.trigger, delays=delays)
        task.trains.append(train)
        for terminal in outputs_of(channel):
            terminals.drive(terminal, train)
    task.clock.start = task.trains[0].start


def begin_ticks(terminals: Terminals, task: Task, now: float) -> None:
    """Let a task's sample clock stand at its terminal."""
    if task.edges is not None:
        task.ticks = task.edges
    else:
        first, half = task.clock.time(task.offset), np.array([0.5 / task.clock.rate_hz])
        total = task.total if task.pretrigger is None else None
        task.ticks = PulseTrain(now if first is None else first, half, half, total)
    for name in task.emits:
        if name.endswith("/SampleClock"):
            terminals.drive(name, task.ticks)
        elif name.endswith("/StartTrigger"):
            terminals.drive(name, PulseTrain(now, *_PULSE, 1))


_PULSE = np.array([50e-9]), np.array([50e-9])
"""High and low part of the pulse of a start trigger (s; estimate)."""


def promised(tasks: Iterable[Task]) -> set[str]:
    """Terminals that `tasks` drive while they run: of counter outputs, and to which signals are exported."""
    found: set[str] = set()
    for task in tasks:
        if task.channels and task.kind == "co":
            found.update(name for channel in task.channels for name in outputs_of(channel))
        for prefix in _EXPORTED if task.channels else ():
            target = str(task.setting("ExportedSignal", f"{prefix}_OUTPUT_TERM", ""))
            found.update(task.device.full(name.strip()) for name in target.split(",") if name.strip())
    return found


def change_pulses(
    terminals: Terminals, task: Task, now: float, pulses: tuple[FloatArray, FloatArray]
) -> None:
    """Let a running task continue with other pulses, (channels, pulses) s high and low, after this one."""
    high, low = pulses
    for row, (channel, train) in enumerate(zip(task.channels, list(task.trains), strict=True)):
        follower = PulseTrain(train.next_end(now), high[row], low[row], None, train.idle)
        task.trains[row] = follower
        for terminal in outputs_of(channel):
            terminals.drive(terminal, follower)


def export(inventory: Inventory, terminals: Terminals, task: Task) -> None:
    """Let the terminals to which a task exports its signals carry them."""
    for prefix, inner in _EXPORTED.items():
        target = task.setting("ExportedSignal", f"{prefix}_OUTPUT_TERM", "")
        number = re.sub(r"[^0-9]", "", task.channels[0].physical[0])
        source = inner.format(kind=task.kind, number=number)
        for name in map(str.strip, str(target).split(",")) if target else ():
            terminals.connect(
                f"/{task.device.chassis or task.device.name}/{source}", inventory.terminal(task.device, name)
            )


def outputs_of(channel: Channel) -> list[str]:
    """Terminals at which a counter output's pulses stand: inside the device, and at its connector if any."""
    home = channel.device.chassis or channel.device.name
    inner = f"/{home}/Ctr{re.sub(r'[^0-9]', '', channel.physical[0])}InternalOutput"
    return [inner, *filter(None, [pulse_terminal(channel)])]


def pulse_terminal(channel: Channel) -> str:
    """Terminal of a counter output's pulses: the program's choice, or the card's own; empty without one."""
    asked = channel.values.get("CO_PULSE_TERM")
    if asked:
        return channel.device.full(str(asked))
    number = int(re.sub(r"[^0-9]", "", channel.physical[0]))
    if channel.device.chassis or channel.device.product.slots or channel.product.family not in _PULSES_AT:
        return ""
    name = f"PFI{_PULSES_AT[channel.product.family] + number}"
    return f"/{channel.device.name}/{name}" if channel.device.has_terminal(name) else ""


def timing_edges(inventory: Inventory, terminals: Terminals, task: Task, now: float) -> Edges | None:
    """Return the edges that time a task's samples from `now` (s) on; None when its own clock does."""
    if task.retriggered and task.trigger is not None and task.kind != "co":
        return Bursts(task.trigger, task.samples_asked, task.rate_hz, task.start_delay)
    if not task.timed or task.kind == "co":
        return None
    if task.shares is None and task.detects_changes:
        return _changes(inventory, terminals, task, now)
    terminal = task.shares or outside_clock(inventory, terminals, task)
    if not terminal or (task.shares is not None and not terminals.irregular(terminal)):
        return None
    return _edges_of_clock(terminals, task, terminal, now)


def _changes(inventory: Inventory, terminals: Terminals, task: Task, now: float) -> Edges | None:
    """Return the changes of lines that a task detects; None where nothing drives them."""
    watched = [
        (f"/{device.name}/{line}", edge == "RISING")
        for edge in ("RISING", "FALLING")
        for device, tail in _change_lines(inventory, task, edge)
        for line in device.lines_of(tail)
    ]
    # Lines of simulated devices that nobody drives count up, and change at each sample.
    if task.device.simulated and not any(terminals.signalled(name) for name, _ in watched):
        return None
    edges = Edges(terminals, watched, now, max(c.filter_width("DI_TERM") for c in task.channels))
    for name in task.emits:
        if name.endswith("ChangeDetectionEvent"):
            terminals.drive(name, edges)
    return edges


def _edges_of_clock(terminals: Terminals, task: Task, terminal: str, now: float) -> Edges:
    """Return the edges of a clock that does not tick evenly. Raises DaqmxError for outputs."""
    if task.kind in ("ao", "do"):
        raise unserved(f"the twin does not clock outputs by the signal at {terminal}.")
    rising = task.setting("Timing", "SAMP_CLK_ACTIVE_EDGE", Edge.RISING.value) == Edge.RISING.value
    before = float(np.nextafter(now, -np.inf))
    return Edges(terminals, [(terminal, rising)], before, _filter(task, "Timing", "SAMP_CLK_SRC"))


def _filter(task: Task, kind: str, source: str) -> float:
    """Pulse that the digital filter of a task's clock or trigger lets pass (s); 0 without one."""
    return filter_width(task.device.product, source, partial(task.setting, kind))


def outside_clock(inventory: Inventory, terminals: Terminals, task: Task) -> str:
    """Terminal of a sample clock that a signal from outside drives; empty for any other.

    Raises DaqmxError for outputs, which are not simulated on such a clock.
    """
    source = task.setting("Timing", "SAMP_CLK_SRC", "")
    terminal = inventory.terminal(task.device, source) if source and task.timed else ""
    if not terminal or terminal in task.emits or _OF_TASKS.search(terminal):
        return ""
    if not (terminals.signalled(terminal) or terminal.endswith("ChangeDetectionEvent")):
        return ""
    if task.kind in ("ao", "do"):
        raise unserved(f"the twin does not clock outputs by the signal at {terminal}.")
    return terminal


def _change_lines(inventory: Inventory, task: Task, edge: str) -> list[tuple[NiDevice, str]]:
    listed = task.setting("Timing", f"CHANGE_DETECT_DI_{edge}_EDGE_PHYSICAL_CHANS", "")
    return list(inventory.resolve(", ".join(task.device.listed(listed)))) if listed else []


def start_edges(inventory: Inventory, terminals: Terminals, task: Task, now: float) -> Edges | None:
    """Return the edges for which a task's start trigger waits from `now` (s) on; None without a signal."""
    for which in ("START", "ARM_START"):
        source = task.setting("Trig", f"DIG_EDGE_{which}_TRIG_SRC", "")
        if not source or task.setting("Trig", f"{which}_TRIG_TYPE") != TriggerType.DIGITAL_EDGE.value:
            continue
        terminal = inventory.terminal(task.device, source)
        anothers = bool(_OF_TASKS.search(terminal))
        signalled = terminals.signalled(terminal) or terminal.endswith("ChangeDetectionEvent")
        if not (task.retriggered and anothers) and (anothers or not signalled):
            continue
        rising = task.setting("Trig", f"DIG_EDGE_{which}_TRIG_EDGE", Edge.RISING.value) == Edge.RISING.value
        width = _filter(task, "Trig", f"DIG_EDGE_{which}_TRIG_SRC")
        # What starts at this very moment is later on a card.
        return Edges(terminals, [(terminal, rising)], float(np.nextafter(now, -np.inf)), width)
    return None


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
    return now + GLIMPSE if task.waits() else None


def _look_for_reference(terminals: Terminals, source: str, task: Task, now: float) -> None:
    rate_hz, start = task.clock.rate_hz, task.clock.start or 0.0
    first = start + (task.pretrigger or 0) / rate_hz
    rising = task.setting("Trig", "DIG_EDGE_REF_TRIG_EDGE", Edge.RISING.value) == Edge.RISING.value
    width = _filter(task, "Trig", "DIG_EDGE_REF_TRIG_SRC")
    found = terminals.watched(source, width)(first, now).to(rising)
    if len(found):
        late = float(task.setting("Trig", "REF_TRIG_DELAY", 0.0))
        task.reference = int(np.ceil((found[0] + late - start) * rate_hz - 1e-6))
