"""The NI system behind the wire: devices, tasks, reservations, and clocks shared between tasks."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

from ..base.clock import Clock, VirtualClock
from .converter import STOPPED, noise_of
from .devices import Inventory, NiDevice
from .errors import AlreadyExistsError, DaqmxError, DAQmxErrors
from .failures import Failures
from .nodes import Nodes, PlayStopped
from .signalling import (
    GLIMPSE,
    begin_measuring,
    begin_pulses,
    begin_ticks,
    export,
    glimpse,
    outside_clock,
    promised,
    reference_terminal,
    sources,
    start_edges,
    timing_edges,
)
from .tasks import State, Task, session_of
from .teds import Teds
from .terminals import OutputTerminal, Terminals
from .verifying import refuse_auto_start, refuse_small_buffer, refuse_terminals, refuse_unsimulated, verify

_LONGEST_WAIT = 86_400.0
"""Time-out of a wait without one (s): every wait has a deadline."""


class NiSystem:
    """State shared by all clients of one server. Methods must be called with `lock` held."""

    def __init__(
        self,
        inventory: Inventory,
        clock: Clock,
        nodes: Nodes | None,
        wiring: Mapping[str, str],
        rtsi: bool,
        seed: int,
    ) -> None:
        self.inventory = inventory
        self.scales = {name: scale.copy() for name, scale in inventory.scales.items()}
        self.saved_tasks: dict[str, object] = {}
        self.saved_channels: dict[str, object] = {}
        self.upkeep: dict[tuple[str, str], Any] = {}
        """What programs have stored in devices and terminals, by their names and that of the property."""
        self.teds: dict[str, Teds] = {}
        """Sensors that describe themselves, by physical channel."""
        self.clock = clock
        self.nodes = nodes
        self.wiring = dict(wiring)
        self.rtsi = rtsi
        self.seed = seed
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        self.tasks: dict[str, Task] = {}
        self.unserved: Counter[str] = Counter()
        """Counts of the calls and properties that clients requested and this wire does not serve."""
        self.call_time = 0.0
        """Time that a look takes on a virtual clock (s), so that a program that polls comes to an end."""
        self.caller = threading.local()
        """Of the thread that serves a call: `in_callback` is True for one made in a callback, and `process`
        is the program that makes it, empty for a client of a server."""
        self.move: Callable[[float, bool], None] = lambda until, _in_callback: self._jump(until)
        """Moves a virtual clock to a time (s), or to an event before it."""
        self.created = ""
        """Names of the channels that the last call made, as NI writes a list."""
        self.epoch = datetime.now(UTC) - timedelta(seconds=clock.now())
        """Calendar time of the clock's origin."""
        self.outputs = {
            name: OutputTerminal(wired=name in self.wiring)
            for device in inventory.devices.values()
            for name in (*device.ao, *device.lines)
        }
        self.terminals = Terminals(
            self.wiring, nodes, self.outputs, lambda: promised(self.tasks.values()), rtsi
        )
        self._reserved: dict[tuple[str, str], Task] = {}
        self.failures = Failures(inventory)
        self._acquisitions: Counter[str] = Counter()
        self.polled: Counter[str] = Counter()
        """Samples that programs have taken of each device's analog inputs without a clock."""
        self._unnamed: Counter[str] = Counter()
        for name, node in self.wiring.items():
            if nodes is not None and name in self.outputs and "/ao" in name:
                nodes.drive(node, self.outputs[name])

    # Tasks by session

    def create_task(self, name: str, behavior: int = 0) -> tuple[Task, bool]:
        """Return the task called `name`, created if necessary, and True when it is new.

        A name is unique in the program that calls. `behavior` is NI's `SessionInitializationBehavior`: by
        default a task of this name is attached to. The driver itself refuses a second one. Raises
        AlreadyExistsError, or DaqmxError.
        """
        new_only, attach_only = 1, 2
        process = getattr(self.caller, "process", "")
        session = session_of(name, process)
        if name and session in self.tasks:
            if behavior == new_only:
                raise AlreadyExistsError(
                    f"Specified task cannot be created: a task named {name!r} exists already. Close it first."
                )
            return self.tasks[session], False
        if behavior == attach_only:
            raise DaqmxError(DAQmxErrors.INVALID_TASK, f"There is no task named {name!r}.")
        if not name:
            name = f"_unnamedTask<{self._unnamed[process]:X}>"
            self._unnamed[process] += 1
        task = Task(name, process)
        self.tasks[task.session] = task
        return task, True

    def task(self, name: str) -> Task:
        """Return the task of the session `name`. Raises DaqmxError."""
        try:
            return self.tasks[name]
        except KeyError:
            raise DaqmxError(
                DAQmxErrors.INVALID_TASK, f"Task specified is invalid or does not exist: {name!r}."
            ) from None

    def clear_task(self, task: Task) -> None:
        """Stop a task, release its resources and remove it."""
        self.stop(task)
        self.release(task)
        self.tasks.pop(task.session, None)
        self.changed.notify_all()

    def reset_device(self, device: NiDevice) -> None:
        """Abort its tasks. Outputs fall to 0 V, an E Series card's not (docs/hardware.md, "All NI cards")."""
        for task in [t for t in self.tasks.values() if t.channels and device in t.devices]:
            self.stop(task)
            self.release(task)
        if device.product.family != "E Series":
            for name in device.ao:
                if self.outputs[name].driven:
                    self.outputs[name].hold(0.0, self.clock.now())

    # States

    def verify(self, task: Task) -> None:
        """Check the combination of a task's settings. Raises DaqmxError."""
        verify(task)
        refuse_terminals(self.inventory, task)

    def reserve(self, task: Task) -> None:
        """Reserve all resources of a task, or none. Raises DaqmxError."""
        if task.state >= State.RESERVED and not task.changed:
            return
        if task.watchdog is not None:
            task.state = State.RESERVED
            return
        self.failures.refuse(task, reserving=True)
        self.verify(task)
        wanted = task.resources
        for key in wanted:
            holder = self._reserved.get(key)
            if holder is not None and holder is not task:
                raise DaqmxError(
                    DAQmxErrors.PAL_RESOURCE_RESERVED,
                    f"The specified resource is reserved: {key[0]}/{key[1]} by task {holder.name!r}.",
                )
        self._reserved = {key: t for key, t in self._reserved.items() if t is not task}
        self._reserved.update(dict.fromkeys(wanted, task))
        task.state, task.changed = State.RESERVED, False

    def commit(self, task: Task) -> None:
        """Reserve a task, and check that its clocks and triggers can be routed. Raises DaqmxError."""
        self.reserve(task)
        if task.state < State.COMMITTED:
            if task.watchdog is None:
                sources(self.inventory, self.rtsi, task)
                refuse_unsimulated(task, self.wiring, self.terminals.signalled)
                outside_clock(self.inventory, self.terminals, task)
            task.state = State.COMMITTED

    def release(self, task: Task) -> None:
        """Stop a task and release its resources."""
        self.stop(task)
        self._reserved = {key: t for key, t in self._reserved.items() if t is not task}
        task.state, task.changed = State.UNVERIFIED, False

    def changed_properties(self, task: Task) -> None:
        """Verify a task again when it is next used; until then it keeps its state, and what it has reserved.

        (NI-DAQmx Key Concepts, "Transitioning the State Backwards".)
        """
        task.changed = task.state >= State.RESERVED

    def start(self, task: Task, auto: bool = False) -> None:
        """Start a task, at once or when its clock or trigger comes. Raises DaqmxError."""
        if task.running:
            raise DaqmxError(
                DAQmxErrors.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING,
                f"Specified operation cannot be performed while the task is running: {task.name!r}.",
            )
        if task.watchdog is not None:
            task.watchdog.start(self.clock.now())
            task.state = State.RUNNING
            return
        if not task.is_input and task.timed and task.kind != "co" and not task.buffer.shape[1]:
            raise DaqmxError(
                DAQmxErrors.OUTPUT_BUFFER_EMPTY,
                f"The generation of {task.name!r} cannot be started, because the output buffer is empty: "
                "write to it first.",
            )
        refuse_auto_start(task, auto)
        before = task.state
        self.commit(task)
        refuse_small_buffer(task)
        shares, triggers = sources(self.inventory, self.rtsi, task)
        task.begin(before, shares, auto)
        now = self.clock.now()
        if task.kind == "ai" and task.timed:
            task.noise = {
                device.name: noise_of(self.seed, device.name, self._acquisitions[device.name])
                for device in task.devices
            }
            self._acquisitions.update(device.name for device in task.devices)
        task.waits_for = set(triggers)
        if shares is not None and not self._joins(task, shares, now):
            task.waits_for.add(shares)
        task.trigger = start_edges(self.inventory, self.terminals, task, now)
        if not task.waits_for and (task.trigger is None or task.retriggered):
            self._go(task, now)
        self.changed.notify_all()

    def notice(self) -> None:
        """Do what time has brought: start tasks whose trigger has come, let watchdogs expire."""
        now = self.clock.now()
        for task in list(self.tasks.values()):
            if task.watchdog is not None:
                task.watchdog.guard(self.outputs, now)
            if not task.running or task.trigger is None or task.waits_for or task.retriggered:
                continue
            if task.trigger.count(now):
                when, task.trigger = float(task.trigger.times[0]), None
                self._go(task, when)

    def stop(self, task: Task) -> None:
        """Stop a task; outputs hold their last value."""
        if not task.running:
            return
        if task.watchdog is not None:
            task.watchdog.stop()
            task.state = State.COMMITTED
            return
        now = self.clock.now()
        if task.shares is None and task.clock.start is not None:
            task.clock.stopped = now
        elif task.clock.start is not None:
            task.clock = replace(task.clock, stopped=now)
        for name in self.rows(task) if not task.is_input and task.kind != "co" else ():
            self.outputs[name].stop(now)
        for train in (*task.trains, *filter(None, [task.ticks])):
            train.stopped = min(train.stopped, now)
        task.state = State.COMMITTED
        task.waits_for = set()
        task.trigger = None
        task.on_demand = 0
        if not task.is_input:
            task.written = 0
        if task.state_before < State.RESERVED:
            self.release(task)
        task.state = task.state_before
        self.changed.notify_all()

    def cut_off(self, task: Task) -> None:
        """Stop a task of outputs whose play a fault ends now."""
        if self.nodes is None or not task.running or task.kind != "ao" or not task.timed:
            return
        try:
            self.nodes.plays(task.device.name)
        except PlayStopped as stopped:
            self.stop(task)
            if stopped.how in STOPPED:
                task.failure = DaqmxError(
                    DAQmxErrors(STOPPED[stopped.how]), f"The generation of {task.name!r} has stopped."
                )

    def rows(self, task: Task) -> list[str]:
        """Return the terminals of a task, one for each row of its buffer."""
        return [f"{c.device.name}/{p}" for c in task.channels for p in c.physical]

    def is_driven(self, device: NiDevice, line: str) -> bool:
        """Return True when a task has reserved a digital line as an output."""
        return (device.name, f"do {line}") in self._reserved

    # Waiting

    def wait(
        self,
        done: Callable[[], bool],
        due: Callable[[], float | None],
        timeout: float,
        alive: Callable[[], bool] = lambda: True,
    ) -> bool:
        """Wait until `done()`; return False when `timeout` (s; negative for no limit) passes first.

        `due()` returns the expected time of completion (s), or None if unknown. A virtual clock jumps to
        that time; a real clock is waited for. Also returns False when the waiting client is gone.
        """
        deadline = self.clock.now() + (timeout if timeout >= 0 else _LONGEST_WAIT)
        while True:
            self.notice()
            if done():
                return True
            now = self.clock.now()
            if now >= deadline or not alive():
                return False
            target = due()
            target = deadline if target is None else min(target, deadline)
            if any(task.trigger is not None for task in self.tasks.values()):
                target = min(target, now + GLIMPSE)
            if isinstance(self.clock, VirtualClock):
                self.move(target, getattr(self.caller, "in_callback", False))
                self.changed.notify_all()
            else:
                self.changed.wait(min(max(target - now, 1e-4), 0.25))

    def look(self) -> None:
        """Let the time pass that it takes a program to look whether there is something new."""
        if self.call_time and isinstance(self.clock, VirtualClock):
            until = self.clock.now() + self.call_time
            while self.clock.now() < until:
                self.move(until, getattr(self.caller, "in_callback", False))

    def _jump(self, until: float) -> None:
        assert isinstance(self.clock, VirtualClock)
        self.clock.sleep_until(until)

    # Clocks and triggers between tasks

    def glimpse(self, task: Task) -> float | None:
        """Time to look again at a task whose next sample the signals decide (s); None for another."""
        return glimpse(self.inventory, self.terminals, task, self.clock.now())

    def _joins(self, task: Task, terminal: str, now: float) -> bool:
        """Join a task to the clock at `terminal` from its next edge; return False if it is not running."""
        for other in self.tasks.values():
            if other is task or not other.channels or not other.running or other.waits_for:
                continue
            if terminal in other.emits:
                task.clock = other.clock
                task.offset = other.clock.edges(now)
                return True
        return False

    def _go(self, task: Task, now: float) -> None:
        """Begin sampling at `now` (s), and start the tasks that waited for this one."""
        export(self.inventory, self.terminals, task)
        task.edges = timing_edges(self.inventory, self.terminals, task, now)
        if task.shares is None:
            task.clock.start = now + task.start_delay
            # Before a reference trigger it runs on; then the count of samples ends the task.
            task.clock.total = task.total if task.pretrigger is None else None
        if not task.is_input and task.timed and task.kind != "co":
            self.play(task)
        if task.timed and task.kind != "co" and not task.implicit:
            begin_ticks(self.terminals, task, now)
        if task.kind == "co":
            begin_pulses(self.terminals, task, self.regenerates(task), now)
        elif task.kind == "ci":
            begin_measuring(self.terminals, task, now)
        if task.pretrigger is not None and not reference_terminal(self.inventory, self.terminals, task):
            # As on NI's simulated devices: a signal that nothing drives is there at once.
            task.reference = task.pretrigger
        for terminal in task.emits:
            for other in list(self.tasks.values()):
                if other.running and terminal in other.waits_for:
                    other.waits_for.discard(terminal)
                    if terminal == other.shares:
                        other.clock, other.offset = task.clock, task.offset
                    if not other.waits_for and other.trigger is None:
                        self._go(other, now)

    def play(self, task: Task) -> None:
        """Pass a generation's buffer to its output terminals."""
        for name, row in zip(self.rows(task), task.buffer, strict=True):
            self.outputs[name].play(row, task.clock, task.offset, task.total, self.regenerates(task))

    @staticmethod
    def regenerates(task: Task) -> bool:
        """Return True when the output buffer repeats after its end."""
        return bool(task.setting("Write", "REGEN_MODE", 10097) == 10097)
