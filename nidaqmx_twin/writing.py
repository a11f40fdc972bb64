"""Common part of the write calls: software-timed steps, and buffers played by a sample clock."""

from __future__ import annotations

from typing import Any

import numpy as np
from nidaqmx.constants import WriteRelativeTo

from ..base.arrays import FloatArray
from .converter import put_out
from .errors import DaqmxError, DAQmxErrors
from .reading import Alive
from .system import NiSystem
from .tasks import Task


def space(system: NiSystem, task: Task) -> int:
    """Return the samples per channel that can be written without waiting."""
    if system.regenerates(task) or not task.running:
        return task.buffer_size
    return max(0, _capacity(task) - (task.written - task.count(system.clock.now())))


def _capacity(task: Task) -> int:
    """Return the joint capacity of the host's and the card's buffers (samples per channel)."""
    return task.buffer_size + task.device.product.ao_fifo


def put(system: NiSystem, task: Task, rows: FloatArray, request: Any, alive: Alive) -> int:
    """Put (terminals, samples) out or into the buffer, as a write call's `request` says; return the samples
    per channel written.

    Raises DaqmxError.
    """
    if task.is_input:
        raise DaqmxError(
            DAQmxErrors.WRITE_NO_OUTPUT_CHANS_IN_TASK,
            f"Write cannot be performed, because task {task.name!r} has no output channels.",
        )
    for other in system.tasks.values():
        if other.watchdog is not None:
            other.watchdog.refuse(task.device, system.clock.now())
    _refuse_values(task, rows)
    if task.kind == "ao":
        rows = np.array([
            row if channel.scale is None else channel.scale.to_volts(row)
            for channel, row in zip(task.channels, rows, strict=True)
        ]).reshape(rows.shape)  # fmt: skip
        rows = put_out(rows, task.device.product)
    elif task.kind == "do":
        turned = [bool(c.values.get("DO_INVERT_LINES")) for c in task.channels for _ in c.physical]
        rows = np.where(np.array(turned)[:, np.newaxis], 1.0 - rows, rows)
    count = int(rows.shape[1])
    if not task.timed:
        _step(system, task, rows, request.auto_start)
        return count
    _refuse_beyond(system, task, count)
    if task.running and not system.regenerates(task):
        _queue(system, task, rows, request.timeout, alive)
    else:
        _fill(system, task, rows)
    if request.auto_start and not task.running:
        system.start(task, auto=True)
    system.changed.notify_all()
    return count


def _refuse_beyond(system: NiSystem, task: Task, count: int) -> None:
    """Refuse more samples than a finite generation without repetition puts out: NI's name of the code."""
    if task.running and task.total is not None and not system.regenerates(task) and (
        task.written + count > task.total
    ):  # fmt: skip
        raise DaqmxError(
            DAQmxErrors.CANNOT_WRITE_BEYOND_FINAL_FINITE_SAMPLE,
            f"Write cannot be performed beyond the last of the {task.total} samples of the finite task "
            f"{task.name!r}.",
            written=0,
        )


def _step(system: NiSystem, task: Task, rows: FloatArray, auto_start: bool) -> None:
    if not task.running:
        if not auto_start:
            raise DaqmxError(
                DAQmxErrors.CANNOT_WRITE_WHEN_AUTO_START_FALSE_AND_TASK_NOT_RUNNING,
                "Write failed, because the task is not started, is on demand, and auto start is false.",
            )
        system.start(task, auto=True)
    system.look()
    now = system.clock.now()
    for name, row in zip(system.rows(task), rows, strict=True):
        system.outputs[name].hold(float(row[-1]), now)
    task.on_demand += rows.shape[1]
    if task.auto_started:
        system.stop(task)


def _fill(system: NiSystem, task: Task, rows: FloatArray) -> None:
    """Write into a buffer that is not playing, or that repeats."""
    count = rows.shape[1]
    asked = task.setting("Buffer", "OUTPUT_BUF_SIZE")
    position = task.written
    if task.setting("Write", "RELATIVE_TO") == WriteRelativeTo.FIRST_SAMPLE.value:
        position = 0
    position += int(task.setting("Write", "OFFSET", 0))
    if asked and not system.regenerates(task) and position + count > asked + task.device.product.ao_fifo:
        raise DaqmxError(
            DAQmxErrors.NO_MORE_SPACE,
            f"Write cannot be performed, because there is no space for {count} samples per channel in the "
            f"buffer of {task.name!r}, which is not playing yet and has room for {asked}.",
            written=0,
        )
    if not task.running and not task.written:
        task.buffer = np.zeros((len(rows), 0))
        task.first_write, task.dropped = count, 0
    grows = not asked or not system.regenerates(task)
    size = int(asked) if not grows else max(task.buffer.shape[1], count if task.running else position + count)
    if size != task.buffer.shape[1]:
        grown = np.zeros((len(rows), size))
        kept = min(size, task.buffer.shape[1])
        grown[:, :kept] = task.buffer[:, :kept]
        task.buffer = grown
    else:
        task.buffer = task.buffer.copy()
    task.buffer[:, (position + np.arange(count)) % size] = rows
    task.written = position + count
    if task.running:
        now = system.clock.now()
        for name, row in zip(system.rows(task), task.buffer, strict=True):
            system.outputs[name].replace(row, now)


def _queue(system: NiSystem, task: Task, rows: FloatArray, timeout: float, alive: Alive) -> None:
    """Append to a playing buffer without repetition; the wait for space paces the program."""
    _refuse_underflow(system, task)
    excess = task.written + rows.shape[1] - _capacity(task)

    def due() -> float | None:
        return task.ready(excess)

    fits = system.wait(
        lambda: not task.running or task.count(system.clock.now()) >= excess, due, timeout, alive
    )
    _refuse_underflow(system, task)
    now = system.clock.now()
    if not fits:
        rows = rows[:, : space(system, task)]
    count = rows.shape[1]
    played = task.count(now)
    task.buffer = np.concatenate([task.buffer[:, played - task.dropped :], rows], axis=1)
    task.dropped = played
    task.written += count
    for name, row in zip(system.rows(task), task.buffer, strict=True):
        system.outputs[name].replace(row, now, played)
    if not fits:
        raise DaqmxError(
            DAQmxErrors.SAMPLES_CAN_NOT_YET_BE_WRITTEN,
            f"Some or all of the samples to write could not be written to the buffer of {task.name!r} yet.",
            written=count,
        )


def _refuse_underflow(system: NiSystem, task: Task) -> None:
    if task.total is None and task.count(system.clock.now()) > task.written:
        task.failure = DaqmxError(
            DAQmxErrors.GEN_STOPPED_TO_PREVENT_REGEN_OF_OLD_SAMPLES,
            f"The generation of {task.name!r} has stopped to prevent the regeneration of old samples: "
            "the application was unable to write samples fast enough.",
        )
        raise task.failure


def _refuse_values(task: Task, rows: FloatArray) -> None:
    if task.kind != "ao":
        return
    for channel, row in zip(task.channels, rows, strict=True):
        slack = 1e-9 * channel.full_scale
        if not np.all(np.isfinite(row)) or (len(row) and (
            row.min() < channel.low - slack or row.max() > channel.high + slack
        )):  # fmt: skip
            raise DaqmxError(
                DAQmxErrors.INVALID_AO_DATA_WRITE,
                f"Attempted writing analog data that is too large or too small: {channel.name} takes "
                f"{channel.low:g} V to {channel.high:g} V.",
            )
