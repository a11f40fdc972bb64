"""Common part of the read calls: wait for a task's samples, and return the requested channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from nidaqmx.constants import LoggingMode, OverwriteMode, ReadRelativeTo

from . import inputs
from .channel import Channel
from .errors import DaqmxError, DAQmxErrors
from .names import names_in
from .system import NiSystem
from .tasks import State, Task
from .tdms import log

_TO_TRIGGER = (ReadRelativeTo.FIRST_PRETRIGGER_SAMPLE.value, ReadRelativeTo.REFERENCE_TRIGGER.value)
Alive = Callable[[], bool]
"""Returns True while the waiting client is connected."""
Call = Callable[[NiSystem, Any, Alive], Any]
"""Serves a request."""


@dataclass(frozen=True)
class Taken:
    """Samples of one read: (rows, samples) of `channels`, from sample `first`."""

    channels: tuple[Channel, ...]
    rows: Any
    first: int
    status: int = 0

    @property
    def count(self) -> int:
        """Samples per channel."""
        return int(self.rows.shape[1])

    @property
    def scaled(self) -> Any:
        """The samples in the units of each channel's custom scale, or in volts without one."""
        if all(channel.scale is None for channel in self.channels):
            return self.rows
        return np.array([
            row if channel.scale is None else channel.scale.to_units(row)
            for channel, row in zip(self.channels, self.rows, strict=True)
        ]).reshape(self.rows.shape)  # fmt: skip

    def lines(self) -> list[tuple[Channel, Any]]:
        """Return each channel with the rows of its own lines."""
        ends = np.cumsum([len(channel.physical) for channel in self.channels])
        return list(zip(self.channels, np.split(self.rows, ends[:-1]), strict=True))


def take_one(system: NiSystem, request: Any, alive: Alive) -> Taken:
    """Wait for one sample per channel and return it. Raises DaqmxError, also when none comes in time."""
    taken = take(system, request, alive)
    if not taken.count:
        raise DaqmxError(
            DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE,
            "Some or all of the samples requested have not yet been acquired.",
            read=0,
        )
    return taken


def take(system: NiSystem, request: Any, alive: Alive, room: int | None = None) -> Taken:
    """Wait for the samples that a read call wants, one per channel by default. Raises DaqmxError.

    -1 means all samples of a finite task, or the samples available now, at most those that fit: the program
    allocated its array, of `room` samples, before more arrived.
    """
    task, timeout = system.task(request.task.name), request.timeout
    wanted = getattr(request, "num_samps_per_chan", 1)
    room = getattr(request, "array_size_in_samps", None) if room is None else room
    space = None if room is None else room // max(1, len(wanted_channels(task)))
    _refuse_unreadable(system, task)
    began = 0
    if not task.running:
        # It is false where events are registered (nidaqmx-python, issues 191 and 205).
        if task.state < State.COMMITTED and not task.setting("Read", "AUTO_START", not task.heard):
            raise DaqmxError(
                DAQmxErrors.CANNOT_READ_WHEN_AUTO_START_FALSE_AND_TASK_NOT_RUNNING_OR_COMMITTED,
                f"Read cannot be performed, because task {task.name!r} is neither running nor committed, and "
                "auto start is false.",
                read=0,
            )
        system.start(task, auto=True)
        began = task.warning
    if not task.timed:
        system.look()
        _await_measurement(system, task, timeout, alive)
        taken = inputs.acquire(system, task, max(1, wanted))
        result = Taken(*_wanted(task, taken), max(0, task.on_demand - taken.shape[1]))
        if task.auto_started:
            count = task.on_demand
            system.stop(task)
            # A program that polls a line by software sees the count continue from read to read.
            task.on_demand = count
        return result
    first = _position(system, task)
    left = None if task.total is None else max(0, task.total - first)
    if left == 0 and wanted != 0:
        raise DaqmxError(
            DAQmxErrors.SAMPLES_WILL_NEVER_BE_AVAILABLE,
            "The application is not able to read the requested samples, because all samples of the "
            f"finite task {task.name!r} have been read.",
            read=0,
        )
    if wanted < 0:
        wanted = left if left is not None else max(0, task.count(system.clock.now()) - first)
        if left is None and space is not None:
            wanted = min(wanted, space)
    elif left is not None:
        wanted = min(wanted, left)
    _refuse_lost(system, task, first)
    end = first + wanted
    reached = system.wait(
        lambda: not task.running or task.count(system.clock.now()) >= end or task.failure is not None,
        lambda: system.glimpse(task) or task.ready(end),
        timeout,
        alive,
    )
    if not task.running:
        raise DaqmxError(
            DAQmxErrors.OPERATION_ABORTED, f"Task {task.name!r} was stopped while it was being read.", read=0
        )
    if task.failure is not None:
        raise task.failure
    # While it waits it takes samples out of the buffer, which may be smaller than the read.
    _refuse_lost(system, task, first + wanted)
    count = min(wanted, max(0, task.count(system.clock.now()) - first))
    lines = sum(channel.rows for channel in task.channels)
    rows = inputs.samples(system, task, first, count) if count else np.zeros((lines, 0))
    result = Taken(
        *_wanted(task, rows), first, began if reached else DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE.value
    )
    task.read_position = first + count
    if not count:
        system.look()
    log(system, task)
    if task.auto_started and task.total is not None and task.read_position >= task.total:
        system.stop(task)
    system.changed.notify_all()
    return result


def _await_measurement(system: NiSystem, task: Task, timeout: float, alive: Alive) -> None:
    """Wait for the next measurement of time of a counter that a program reads without a clock."""
    asked = system.clock.now()
    waiting = [meter for meter in task.meters if not meter.counts and not meter.silent]

    def measured() -> bool:
        now = system.clock.now()
        for meter in waiting:
            meter.advance(now)
        return all(len(ends := meter.events()[0]) and ends[-1] > asked for meter in waiting)

    if waiting and not system.wait(measured, lambda: system.glimpse(task), timeout, alive):
        raise DaqmxError(
            DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE,
            "Some or all of the samples requested have not yet been acquired: no edges come to "
            f"{task.name!r}.",
            read=0,
        )


def _refuse_unreadable(system: NiSystem, task: Task) -> None:
    """Raise DaqmxError for a task of outputs or counters, or for an injected failure."""
    if not task.is_input and (task.kind != "do" or task.timed):
        raise DaqmxError(
            DAQmxErrors.READ_NO_INPUT_CHANS_IN_TASK,
            f"Read cannot be performed, because task {task.name!r} has no input channels: only digital "
            "lines written on demand can be read back.",
        )
    if task.setting("Read", "LOGGING_MODE") == LoggingMode.LOG.value:
        raise DaqmxError(
            DAQmxErrors.READ_NOT_SUPPORTED_FOR_LOGGING_MODE,
            f"Data cannot be read while task {task.name!r} logs only: read the file, or set the logging mode "
            "to log and read.",
            read=0,
        )
    injected = system.failures.of_read(task)
    if injected is not None:
        system.stop(task)
        raise DaqmxError(injected, f"The acquisition of {task.device.name} was stopped.", read=0)


def wanted_channels(task: Task) -> tuple[Channel, ...]:
    """Return the channels that the program selected for reading."""
    names = task.setting("Read", "CHANNELS_TO_READ")
    if not names:
        return tuple(task.channels)
    listed = {name.strip().lower() for name in names_in(names)}
    return tuple(channel for channel in task.channels if channel.name.lower() in listed)


def _wanted(task: Task, rows: Any) -> tuple[tuple[Channel, ...], Any]:
    """Return the channels that the program selected for reading, and their rows."""
    wanted = wanted_channels(task)
    places: list[int] = []
    row = 0
    for channel in task.channels:
        if channel in wanted:
            places += range(row, row + channel.rows)
        row += channel.rows
    return wanted, rows if len(places) == len(rows) else rows[places]


def _position(system: NiSystem, task: Task) -> int:
    """Return the index of the next read's first sample."""
    relative = task.setting("Read", "RELATIVE_TO", ReadRelativeTo.CURRENT_READ_POSITION.value)
    offset = int(task.setting("Read", "OFFSET", 0))
    acquired = task.count(system.clock.now())
    if relative in _TO_TRIGGER and task.pretrigger is None:
        raise DaqmxError(
            DAQmxErrors.NO_REF_TRIG_CONFIGURED,
            f"Read cannot be relative to a reference trigger that task {task.name!r} has not.",
            read=0,
        )
    base = {
        ReadRelativeTo.FIRST_SAMPLE.value: 0,
        ReadRelativeTo.FIRST_PRETRIGGER_SAMPLE.value: 0,
        ReadRelativeTo.REFERENCE_TRIGGER.value: task.pretrigger or 0,
        ReadRelativeTo.MOST_RECENT_SAMPLE.value: acquired,
    }.get(relative, task.read_position)
    if _overwrites(task):
        base = max(base, acquired - task.buffer_size)
    return max(0, base + offset)


def available(system: NiSystem, task: Task) -> int:
    """Samples per channel that can be read now: where unread ones are overwritten, what the buffer holds."""
    unread = max(0, task.count(system.clock.now()) - task.read_position)
    return min(unread, task.buffer_size) if _overwrites(task) and task.total is None else unread


def _overwrites(task: Task) -> bool:
    mode = task.setting("Read", "OVERWRITE", OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES.value)
    return bool(mode == OverwriteMode.OVERWRITE_UNREAD_SAMPLES.value)


def _refuse_lost(system: NiSystem, task: Task, first: int) -> None:
    """Raise DaqmxError when the circular buffer has overwritten unread samples."""
    if (
        task.total is None
        and task.count(system.clock.now()) - first > task.buffer_size
        and not _overwrites(task)
    ):
        task.failure = DaqmxError(
            DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE,
            "The application is not able to keep up with the hardware acquisition: sample "
            f"{first} of {task.name!r} has been written over in a buffer of {task.buffer_size} samples "
            "per channel. Read more often, or make the buffer larger.",
            read=0,
        )
        raise task.failure
