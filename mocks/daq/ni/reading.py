"""Read calls: each returns samples in its own format."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import FillMode

from ....instruments.arrays import FloatArray
from .errors import DaqmxError, DAQmxErrors
from .lines import line_order, port_words
from .system import NiSystem
from .taking import Alive, Taken, take, wanted_channels
from .tasks import Task

__all__ = ["READS"]

_TIMING, _PROPERTIES = 1, 2
"""Bits of NI's WaveformAttributeMode, which older clients lack."""


def _reader(
    reply: type[Any], form: Callable[[Taken], Any], read_array: Callable[[Any, Any], bytes | None]
) -> Callable[[NiSystem, Any, Alive], Any]:
    """Make a call that answers with one array, in the order of its fill mode."""

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        space = request.array_size_in_samps // max(1, len(wanted_channels(task)))
        result = take(system, task, request.num_samps_per_chan, request.timeout, alive, space)
        rows = form(result)
        _refuse_small(request.array_size_in_samps, rows.size)
        flat = rows.T if _fill(request) == FillMode.GROUP_BY_SCAN_NUMBER.value else rows
        answer = reply(status=result.status, samps_per_chan_read=result.count)
        packed = read_array(answer, np.ascontiguousarray(flat).ravel())
        return answer if packed is None else answer.SerializeToString() + packed

    return call


def _fill(request: Any) -> int:
    return int(request.fill_mode_raw or request.fill_mode)


def _refuse_small(space: int, needed: int) -> None:
    if space < needed:
        raise DaqmxError(
            DAQmxErrors.READ_BUFFER_TOO_SMALL,
            f"Buffer is too small to fit the read data: {needed} samples into {space}.",
            read=0,
        )


def _doubles(_answer: Any, flat: FloatArray) -> bytes:
    """Encode `read_array` as protobuf field 2, packed: a Python list would take twice as long."""
    payload = flat.astype("<f8", copy=False).tobytes()
    return bytes([2 << 3 | 2]) + _varint(len(payload)) + payload


def _varint(value: int) -> bytes:
    septets = []
    while value > 0x7F:
        septets.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*septets, value])


def _integers(answer: Any, flat: Any) -> None:
    answer.read_array.extend(flat.tolist())


def _bytes(answer: Any, flat: Any) -> None:
    answer.read_array = flat.astype(np.uint8).tobytes()


def _codes(read: Taken) -> Any:
    """Return the samples as codes of the converter."""
    widths = np.array([channel.width for channel in read.channels])[:, np.newaxis]
    return np.rint(read.rows / widths).astype(np.int64)


def _unsigned(bits: int) -> Callable[[Taken], Any]:
    return lambda read: _codes(read) & (2**bits - 1)


def _scaled(read: Taken) -> Any:
    """Return the samples in the units of each channel's custom scale, or in volts without one."""
    if all(channel.scale is None for channel in read.channels):
        return read.rows
    return np.array([
        row if channel.scale is None else channel.scale.to_units(row)
        for channel, row in zip(read.channels, read.rows, strict=True)
    ]).reshape(read.rows.shape)  # fmt: skip


def _words(read: Taken) -> Any:
    return port_words(read.channels, read.rows)


def _raw(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    width = 2 if task.kind == "ai" else 4
    space = request.array_size_in_bytes // max(1, width * len(wanted_channels(task)))
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive, space)
    if task.kind == "ai":
        data = _codes(result).astype("<i2").T
    else:
        data = port_words(result.channels, result.rows).astype("<u4").T
    payload = np.ascontiguousarray(data).tobytes()
    _refuse_small(request.array_size_in_bytes, len(payload))
    return pb.ReadRawResponse(
        status=result.status,
        # Fill the program's whole array, as NI's server does: its client would repeat a shorter one.
        read_array=payload.ljust(request.array_size_in_bytes, b"\0"),
        samps_read=result.count,
        num_bytes_per_samp=data.itemsize,
    )


def _digital_lines(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive)
    width = max(len(channel.physical) for channel in result.channels)
    lines = np.zeros((len(result.channels), result.count, width), dtype=np.uint8)
    row = 0
    for index, channel in enumerate(result.channels):
        mine = result.rows[row : row + len(channel.physical)]
        # In the driver's arrays the lines of a channel are in rising order, independent of their naming.
        order = line_order(channel)
        lines[index, :, : len(order)] = mine[order].T
        row += len(channel.physical)
    if _fill(request) == FillMode.GROUP_BY_SCAN_NUMBER.value:
        lines = lines.transpose(1, 0, 2)
    _refuse_small(request.array_size_in_bytes, lines.size)
    return pb.ReadDigitalLinesResponse(
        status=result.status,
        read_array=lines.tobytes(),
        samps_per_chan_read=result.count,
        num_bytes_per_samp=width,
    )


def _scalar_analog(system: NiSystem, request: Any, alive: Alive) -> Any:
    result = _scalar(system, request, alive)
    return pb.ReadAnalogScalarF64Response(value=float(_scaled(result)[0, 0]))


def _scalar_digital(system: NiSystem, request: Any, alive: Alive) -> Any:
    result = _scalar(system, request, alive)
    words = port_words(result.channels, result.rows)
    return pb.ReadDigitalScalarU32Response(value=int(words[0, 0]))


def _scalar(system: NiSystem, request: Any, alive: Alive) -> Taken:
    result = take(system, system.task(request.task.name), 1, request.timeout, alive)
    if not result.count:
        raise DaqmxError(
            DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE,
            "Some or all of the samples requested have not yet been acquired.",
            read=0,
        )
    return result


def _analog_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive)
    answer = pb.ReadAnalogWaveformsResponse(status=result.status, samps_per_chan_read=result.count)
    for channel, row in zip(result.channels, _scaled(result), strict=True):
        waveform = answer.waveforms.add()
        waveform.y_data.extend(row.tolist())
        _describe(system, task, request, waveform, result.first, channel.name)
        if _mode(request) & _PROPERTIES:
            waveform.attributes["NI_UnitDescription"].string_value = "Volts"
    return answer


def _digital_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive)
    answer = pb.ReadDigitalWaveformsResponse(status=result.status, samps_per_chan_read=result.count)
    row = 0
    for channel in result.channels:
        mine = result.rows[row : row + len(channel.physical)]
        row += len(channel.physical)
        waveform = answer.waveforms.add()
        waveform.signal_count = len(channel.physical)
        waveform.y_data = np.ascontiguousarray(mine.T).astype(np.uint8).tobytes()
        _describe(system, task, request, waveform, result.first, channel.name)
        if _mode(request) & _PROPERTIES:
            names = [f"{channel.device.name}/{line}" for line in channel.physical]
            waveform.attributes["NI_LineNames"].string_value = ", ".join(names)
    return answer


def _mode(request: Any) -> int:
    return int(request.waveform_attribute_mode_raw or request.waveform_attribute_mode)


def _describe(system: NiSystem, task: Task, request: Any, waveform: Any, first: int, name: str) -> None:
    mode = _mode(request)
    if mode & _TIMING and task.timed:
        rate, start = task.clock.rate_hz, task.clock.start or 0.0
        waveform.dt = 1 / rate
        when = system.epoch + timedelta(seconds=start + (task.offset + first) / rate)
        _stamp(waveform.t0, when)
    elif mode & _TIMING:
        _stamp(waveform.t0, system.epoch + timedelta(seconds=system.clock.now()))
    if mode & _PROPERTIES:
        waveform.attributes["NI_ChannelName"].string_value = name


def _stamp(message: Any, when: datetime) -> None:
    """Fill in a PrecisionTimestamp: seconds since 1904, and a fraction in units of 2^-64 s."""
    since = when - datetime(1904, 1, 1, tzinfo=when.tzinfo)
    message.seconds = since.days * 86400 + since.seconds
    message.fractional_seconds = int(since.microseconds / 1e6 * 2**64)


READS: dict[str, Callable[[NiSystem, Any, Alive], Any]] = {
    "ReadAnalogF64": _reader(pb.ReadAnalogF64Response, _scaled, _doubles),
    "ReadBinaryI16": _reader(pb.ReadBinaryI16Response, _codes, _integers),
    "ReadBinaryI32": _reader(pb.ReadBinaryI32Response, _codes, _integers),
    "ReadBinaryU16": _reader(pb.ReadBinaryU16Response, _unsigned(16), _integers),
    "ReadBinaryU32": _reader(pb.ReadBinaryU32Response, _unsigned(32), _integers),
    "ReadDigitalU8": _reader(pb.ReadDigitalU8Response, _words, _bytes),
    "ReadDigitalU16": _reader(pb.ReadDigitalU16Response, _words, _integers),
    "ReadDigitalU32": _reader(pb.ReadDigitalU32Response, _words, _integers),
    "ReadAnalogScalarF64": _scalar_analog,
    "ReadDigitalScalarU32": _scalar_digital,
    "ReadDigitalLines": _digital_lines,
    "ReadRaw": _raw,
    "ReadAnalogWaveforms": _analog_waveforms,
    "ReadDigitalWaveforms": _digital_waveforms,
}
"""Read calls that are served, by name."""
