"""Write calls: software-timed steps, and buffers played by a sample clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import FillMode, WriteRelativeTo

from ....instruments.arrays import FloatArray
from ..converter import put_out
from .channels import field
from .errors import DaqmxError, DAQmxErrors
from .lines import line_order, word_lines
from .system import NiSystem
from .tasks import Channel, Task

__all__ = ["WRITES", "space"]

Alive = Callable[[], bool]


def space(system: NiSystem, task: Task) -> int:
    """Return the samples per channel that can be written without waiting."""
    if system.regenerates(task) or not task.running:
        return task.buffer_size
    return max(0, _capacity(task) - (task.written - task.count(system.clock.now())))


def _capacity(task: Task) -> int:
    """Return the joint capacity of the host's and the card's buffers (samples per channel)."""
    return task.buffer_size + task.device.product.ao_fifo


def _write(
    system: NiSystem, task: Task, rows: FloatArray, auto_start: bool, timeout: float, alive: Alive
) -> int:
    """Put (terminals, samples) out or into the buffer; return the samples per channel written.

    Raises DaqmxError.
    """
    if task.is_input:
        raise DaqmxError(
            DAQmxErrors.WRITE_NO_OUTPUT_CHANS_IN_TASK,
            f"Write cannot be performed, because task {task.name!r} has no output channels.",
        )
    _refuse_values(task, rows)
    if task.kind == "ao":
        rows = np.array([
            row if channel.scale is None else channel.scale.to_volts(row)
            for channel, row in zip(task.channels, rows, strict=True)
        ]).reshape(rows.shape)  # fmt: skip
        rows = put_out(rows, task.device.product)
    count = int(rows.shape[1])
    if not task.timed:
        _step(system, task, rows, auto_start)
        return count
    if task.running and not system.regenerates(task):
        _queue(system, task, rows, timeout, alive)
    else:
        _fill(system, task, rows)
    if auto_start and not task.running:
        system.start(task, auto=True)
    system.changed.notify_all()
    return count


def _step(system: NiSystem, task: Task, rows: FloatArray, auto_start: bool) -> None:
    if not task.running:
        if not auto_start:
            raise DaqmxError(
                DAQmxErrors.CANNOT_WRITE_WHEN_AUTO_START_FALSE_AND_TASK_NOT_RUNNING,
                "Write failed, because the task is not started, is on demand, and auto start is false.",
            )
        system.start(task, auto=True)
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


# Calls


def _matrix(request: Any, data: Any, channels: int) -> Any:
    """Reshape a flat array to (channels, samples), according to the call's data layout."""
    array = np.asarray(data)
    samples = array.size // channels
    if field(request, "data_layout") == FillMode.GROUP_BY_SCAN_NUMBER.value:
        return array.reshape(samples, channels).T
    return array.reshape(channels, samples)


def _writer(
    reply: type[Any], form: Callable[[Task, Any], FloatArray], parse: Callable[[Any], Any]
) -> Callable[[NiSystem, Any, Alive], Any]:
    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        _ = task.kind
        matrix = _matrix(request, parse(request), len(task.channels))
        rows = form(task, matrix)
        written = _write(system, task, rows, request.auto_start, request.timeout, alive)
        return reply(samps_per_chan_written=written)

    return call


def _floats(request: Any) -> FloatArray:
    return np.fromiter(request.write_array, dtype=np.float64, count=len(request.write_array))


def _integers(request: Any) -> Any:
    return np.fromiter(request.write_array, dtype=np.int64, count=len(request.write_array))


def _octets(request: Any) -> Any:
    return np.frombuffer(request.write_array, dtype=np.uint8)


def _volts(task: Task, matrix: Any) -> FloatArray:
    """Return the values unchanged: the limits apply to the program's values, before the converter."""
    return np.asarray(matrix, dtype=np.float64)


def _from_codes(task: Task, matrix: Any) -> FloatArray:
    widths = np.array([channel.width for channel in task.channels])[:, np.newaxis]
    return np.asarray(matrix * widths, dtype=np.float64)


def _signed(bits: int) -> Callable[[Task, Any], FloatArray]:
    """Make a conversion from unsigned codes, which are the two's complement of the converter's."""
    half = 2 ** (bits - 1)
    return lambda task, matrix: _from_codes(task, (matrix + half) % (2 * half) - half)


def _lines(task: Task, words: Any) -> FloatArray:
    return word_lines(task.channels, words)


def _raw(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    channels = len(task.channels)
    if task.kind == "ao":
        codes = np.frombuffer(request.write_array, dtype="<i2").astype(np.int64)
        rows = _from_codes(task, codes[: request.num_samps * channels].reshape(-1, channels).T)
    else:
        size = len(request.write_array) // max(1, request.num_samps * channels)
        words = np.frombuffer(request.write_array, dtype=f"<u{size}")
        rows = word_lines(task.channels, words[: request.num_samps * channels].reshape(-1, channels).T)
    written = _write(system, task, rows, request.auto_start, request.timeout, alive)
    return pb.WriteRawResponse(samps_per_chan_written=written)


def _digital_lines(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    width = max(len(channel.physical) for channel in task.channels)
    octets = np.frombuffer(request.write_array, dtype=np.uint8)
    samples = request.num_samps_per_chan
    if field(request, "data_layout") == FillMode.GROUP_BY_SCAN_NUMBER.value:
        cube = octets.reshape(samples, len(task.channels), width).transpose(1, 0, 2)
    else:
        cube = octets.reshape(len(task.channels), samples, width)
    rows = []
    for channel, lines in zip(task.channels, cube, strict=True):
        order = line_order(channel)
        mine = np.zeros((len(order), samples))
        for column, line in enumerate(order):
            mine[line] = lines[:, column]
        rows.append(mine)
    written = _write(system, task, np.concatenate(rows), request.auto_start, request.timeout, alive)
    return pb.WriteDigitalLinesResponse(samps_per_chan_written=written)


def _scalar_analog(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    rows = _volts(task, np.full((len(task.channels), 1), request.value))
    _write(system, task, rows, request.auto_start, request.timeout, alive)
    return pb.WriteAnalogScalarF64Response()


def _scalar_digital(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    rows = word_lines(task.channels, np.full((len(task.channels), 1), request.value))
    _write(system, task, rows, request.auto_start, request.timeout, alive)
    return pb.WriteDigitalScalarU32Response()


def _analog_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    matrix = np.array([list(waveform.y_data) for waveform in request.waveforms], dtype=np.float64)
    _refuse_count(task, len(matrix))
    written = _write(system, task, _volts(task, matrix), request.auto_start, request.timeout, alive)
    return pb.WriteAnalogWaveformsResponse(samps_per_chan_written=written)


def _digital_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    _refuse_count(task, len(request.waveforms))
    rows = []
    for channel, waveform in zip(task.channels, request.waveforms, strict=True):
        _refuse_lines(channel, waveform.signal_count)
        data = np.frombuffer(waveform.y_data, dtype=np.uint8).reshape(-1, waveform.signal_count)
        rows.append(data.T.astype(np.float64))
    written = _write(system, task, np.concatenate(rows), request.auto_start, request.timeout, alive)
    return pb.WriteDigitalWaveformsResponse(samps_per_chan_written=written)


def _refuse_count(task: Task, waveforms: int) -> None:
    if waveforms != len(task.channels):
        raise DaqmxError(
            DAQmxErrors.WRITE_NUM_CHANS_MISMATCH,
            "Write cannot be performed, because the number of channels in the data does not match the "
            f"number of channels in the task: {waveforms} for {len(task.channels)}.",
        )


def _refuse_lines(channel: Channel, signals: int) -> None:
    if signals != len(channel.physical):
        raise DaqmxError(
            DAQmxErrors.NUM_LINES_MISMATCH_IN_READ_OR_WRITE,
            "Specified read or write operation failed, because the number of lines in the data for a "
            f"channel does not match the number of lines in the channel: {signals} for {channel.name}, "
            f"which has {len(channel.physical)}.",
        )


WRITES: dict[str, Callable[[NiSystem, Any, Alive], Any]] = {
    "WriteAnalogF64": _writer(pb.WriteAnalogF64Response, _volts, _floats),
    "WriteBinaryI16": _writer(pb.WriteBinaryI16Response, _from_codes, _integers),
    "WriteBinaryI32": _writer(pb.WriteBinaryI32Response, _from_codes, _integers),
    "WriteBinaryU16": _writer(pb.WriteBinaryU16Response, _signed(16), _integers),
    "WriteBinaryU32": _writer(pb.WriteBinaryU32Response, _signed(32), _integers),
    "WriteDigitalU8": _writer(pb.WriteDigitalU8Response, _lines, _octets),
    "WriteDigitalU16": _writer(pb.WriteDigitalU16Response, _lines, _integers),
    "WriteDigitalU32": _writer(pb.WriteDigitalU32Response, _lines, _integers),
    "WriteAnalogScalarF64": _scalar_analog,
    "WriteDigitalScalarU32": _scalar_digital,
    "WriteDigitalLines": _digital_lines,
    "WriteRaw": _raw,
    "WriteAnalogWaveforms": _analog_waveforms,
    "WriteDigitalWaveforms": _digital_waveforms,
}
"""Write calls that are served, by name."""
