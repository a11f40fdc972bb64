"""Read and write calls, side by side: each transfers samples in its own format.

A task holds (rows, samples): volts of its analog channels, or 0 and 1 of its digital lines. `take` and `put`
wait for samples and for space; here they are brought into the arrays of the calls, and out of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import FillMode

from ....instruments.arrays import FloatArray
from .channel import Channel
from .errors import DaqmxError, DAQmxErrors
from .fields import field
from .lines import line_order, port_words, word_lines
from .putting import put
from .system import NiSystem
from .taking import Alive, Taken, take, wanted_channels
from .tasks import Task

__all__ = ["TRANSFERS"]

Call = Callable[[NiSystem, Any, Alive], Any]

_TIMING, _PROPERTIES = 1, 2
"""Bits of NI's WaveformAttributeMode, which older clients lack."""


# Arrays of numbers


@dataclass(frozen=True)
class _Format:
    """How the numbers of a call stand for what a task holds."""

    read: Callable[[Taken], Any]
    """Returns (channels, samples) of the call."""
    write: Callable[[Sequence[Channel], Any], FloatArray]
    """Returns what the task holds for (channels, samples) of the call."""
    pack: Callable[[Any, Any], bytes | None]
    """Fills in a reply's array, or returns its bytes, to follow the reply's own."""
    parse: Callable[[Any], Any]
    """Returns the array of a request."""


def _widths(channels: Sequence[Channel]) -> FloatArray:
    return np.array([channel.width for channel in channels])[:, np.newaxis]


def _scaled(read: Taken) -> Any:
    """Return the samples in the units of each channel's custom scale, or in volts without one."""
    if all(channel.scale is None for channel in read.channels):
        return read.rows
    return np.array([
        row if channel.scale is None else channel.scale.to_units(row)
        for channel, row in zip(read.channels, read.rows, strict=True)
    ]).reshape(read.rows.shape)  # fmt: skip


def _as_given(_channels: Sequence[Channel], matrix: Any) -> FloatArray:
    """Return the values unchanged: the limits apply to the program's values, before the converter."""
    return np.asarray(matrix, dtype=np.float64)


def _codes(read: Taken) -> Any:
    """Return the samples as codes of the converter."""
    return np.rint(read.rows / _widths(read.channels)).astype(np.int64)


def _of_codes(channels: Sequence[Channel], codes: Any) -> FloatArray:
    return np.asarray(codes * _widths(channels), dtype=np.float64)


def _words(read: Taken) -> Any:
    return port_words(read.channels, read.rows)


def _pack_doubles(_reply: Any, flat: FloatArray) -> bytes:
    """Encode `read_array` as protobuf field 2, packed: a Python list would take twice as long."""
    payload = flat.astype("<f8", copy=False).tobytes()
    return bytes([2 << 3 | 2]) + _varint(len(payload)) + payload


def _varint(value: int) -> bytes:
    septets = []
    while value > 0x7F:
        septets.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*septets, value])


def _pack_integers(reply: Any, flat: Any) -> None:
    reply.read_array.extend(flat.tolist())


def _pack_octets(reply: Any, flat: Any) -> None:
    reply.read_array = flat.astype(np.uint8).tobytes()


def _parse(dtype: type[Any]) -> Callable[[Any], Any]:
    return lambda request: np.fromiter(request.write_array, dtype, count=len(request.write_array))


def _parse_octets(request: Any) -> Any:
    return np.frombuffer(request.write_array, dtype=np.uint8)


def _unsigned(bits: int) -> _Format:
    """Unsigned codes are the two's complement of the converter's."""
    half = 2 ** (bits - 1)
    return _Format(
        read=lambda read: _codes(read) & (2 * half - 1),
        write=lambda channels, codes: _of_codes(channels, (codes + half) % (2 * half) - half),
        pack=_pack_integers,
        parse=_parse(np.int64),
    )


_SIGNED = _Format(_codes, _of_codes, _pack_integers, _parse(np.int64))
_PORTS = _Format(_words, word_lines, _pack_integers, _parse(np.int64))
_FORMATS = {
    "AnalogF64": _Format(_scaled, _as_given, _pack_doubles, _parse(np.float64)),
    "BinaryI16": _SIGNED,
    "BinaryI32": _SIGNED,
    "BinaryU16": _unsigned(16),
    "BinaryU32": _unsigned(32),
    "DigitalU8": _Format(_words, word_lines, _pack_octets, _parse_octets),
    "DigitalU16": _PORTS,
    "DigitalU32": _PORTS,
}


def _is_by_scan(request: Any, name: str) -> bool:
    """Return True when an array holds sample after sample, of all channels each."""
    return bool(field(request, name) == FillMode.GROUP_BY_SCAN_NUMBER.value)


def _refuse_small(space: int, needed: int) -> None:
    if space < needed:
        raise DaqmxError(
            DAQmxErrors.READ_BUFFER_TOO_SMALL,
            f"Buffer is too small to fit the read data: {needed} samples into {space}.",
            read=0,
        )


def _reader(name: str, form: _Format) -> Call:
    reply = getattr(pb, f"Read{name}Response")

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        space = request.array_size_in_samps // max(1, len(wanted_channels(task)))
        result = take(system, task, request.num_samps_per_chan, request.timeout, alive, space)
        rows = form.read(result)
        _refuse_small(request.array_size_in_samps, rows.size)
        flat = rows.T if _is_by_scan(request, "fill_mode") else rows
        answer = reply(status=result.status, samps_per_chan_read=result.count)
        packed = form.pack(answer, np.ascontiguousarray(flat).ravel())
        return answer if packed is None else answer.SerializeToString() + packed

    return call


def _writer(name: str, form: _Format) -> Call:
    reply = getattr(pb, f"Write{name}Response")

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        _ = task.kind
        flat, channels = np.asarray(form.parse(request)), len(task.channels)
        count = flat.size // channels
        by_scan = _is_by_scan(request, "data_layout")
        matrix = flat.reshape(count, channels).T if by_scan else flat.reshape(channels, count)
        written = put(system, task, form.write(task.channels, matrix), request, alive)
        return reply(samps_per_chan_written=written)

    return call


# One sample


def _read_one(system: NiSystem, request: Any, alive: Alive) -> Taken:
    result = take(system, system.task(request.task.name), 1, request.timeout, alive)
    if not result.count:
        raise DaqmxError(
            DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE,
            "Some or all of the samples requested have not yet been acquired.",
            read=0,
        )
    return result


def _read_volts(system: NiSystem, request: Any, alive: Alive) -> Any:
    value = _scaled(_read_one(system, request, alive))[0, 0]
    return pb.ReadAnalogScalarF64Response(value=float(value))


def _read_word(system: NiSystem, request: Any, alive: Alive) -> Any:
    return pb.ReadDigitalScalarU32Response(value=int(_words(_read_one(system, request, alive))[0, 0]))


def _writer_of_one(reply: type[Any], write: Callable[[Sequence[Channel], Any], FloatArray]) -> Call:
    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        rows = write(task.channels, np.full((len(task.channels), 1), request.value))
        put(system, task, rows, request, alive)
        return reply()

    return call


# Raw samples


def _read_raw(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    coded = (
        "<i2"
        if task.kind == "ai" and task.device.product.ai_bits <= 16
        else "<i4"
        if task.kind == "ai"
        else "<u4"
    )
    width = int(coded[-1])
    space = request.array_size_in_bytes // max(1, width * len(wanted_channels(task)))
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive, space)
    codes = _codes(result) if task.kind == "ai" else result.rows[::2] if task.kind == "ci" else _words(result)
    data = codes.astype(coded).T
    payload = np.ascontiguousarray(data).tobytes()
    _refuse_small(request.array_size_in_bytes, len(payload))
    return pb.ReadRawResponse(
        status=result.status,
        # Fill the program's whole array, as NI's server does: its client would repeat a shorter one.
        read_array=payload.ljust(request.array_size_in_bytes, b"\0"),
        samps_read=result.count,
        num_bytes_per_samp=data.itemsize,
    )


def _write_raw(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    channels = len(task.channels)
    count = request.num_samps * channels
    dtype = "<i2" if task.kind == "ao" else f"<u{len(request.write_array) // max(1, count)}"
    data = np.frombuffer(request.write_array, dtype=dtype)[:count].reshape(-1, channels).T
    rows = _of_codes(task.channels, data) if task.kind == "ao" else word_lines(task.channels, data)
    return pb.WriteRawResponse(samps_per_chan_written=put(system, task, rows, request, alive))


# Lines of a port. In the driver's arrays those of a channel are in rising order, independent of their naming.


def _read_lines(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive)
    width = max(len(channel.physical) for channel in result.channels)
    lines = np.zeros((len(result.channels), result.count, width), dtype=np.uint8)
    for index, (channel, mine) in enumerate(_of_channels(result)):
        lines[index, :, : len(mine)] = mine[line_order(channel)].T
    if _is_by_scan(request, "fill_mode"):
        lines = lines.transpose(1, 0, 2)
    _refuse_small(request.array_size_in_bytes, lines.size)
    return pb.ReadDigitalLinesResponse(
        status=result.status,
        read_array=lines.tobytes(),
        samps_per_chan_read=result.count,
        num_bytes_per_samp=width,
    )


def _write_lines(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    width = max(len(channel.physical) for channel in task.channels)
    samples, channels = request.num_samps_per_chan, len(task.channels)
    octets = _parse_octets(request)
    if _is_by_scan(request, "data_layout"):
        lines = octets.reshape(samples, channels, width).transpose(1, 0, 2)
    else:
        lines = octets.reshape(channels, samples, width)
    rows = []
    for channel, given in zip(task.channels, lines, strict=True):
        order = line_order(channel)
        mine = np.zeros((len(order), samples))
        mine[order] = given[:, : len(order)].T
        rows.append(mine)
    written = put(system, task, np.concatenate(rows), request, alive)
    return pb.WriteDigitalLinesResponse(samps_per_chan_written=written)


def _of_channels(result: Taken) -> list[tuple[Channel, Any]]:
    """Return each channel with the rows of its own lines."""
    ends = np.cumsum([len(channel.physical) for channel in result.channels])
    return list(zip(result.channels, np.split(result.rows, ends[:-1]), strict=True))


# Waveforms


def _read_analog_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive)
    answer = pb.ReadAnalogWaveformsResponse(status=result.status, samps_per_chan_read=result.count)
    for channel, row in zip(result.channels, _scaled(result), strict=True):
        waveform = answer.waveforms.add()
        waveform.y_data.extend(row.tolist())
        _describe(system, request, result, waveform, NI_ChannelName=channel.name, NI_UnitDescription="Volts")
    return answer


def _read_digital_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    result = take(system, task, request.num_samps_per_chan, request.timeout, alive)
    answer = pb.ReadDigitalWaveformsResponse(status=result.status, samps_per_chan_read=result.count)
    for channel, mine in _of_channels(result):
        waveform = answer.waveforms.add()
        waveform.signal_count = len(mine)
        waveform.y_data = np.ascontiguousarray(mine.T).astype(np.uint8).tobytes()
        names = ", ".join(f"{channel.device.name}/{line}" for line in channel.physical)
        _describe(system, request, result, waveform, NI_ChannelName=channel.name, NI_LineNames=names)
    return answer


def _describe(system: NiSystem, request: Any, result: Taken, waveform: Any, **properties: str) -> None:
    """Fill in a waveform's properties, and the time of its first sample, where they are asked for."""
    task, mode = system.task(request.task.name), int(field(request, "waveform_attribute_mode"))
    for name, text in properties.items() if mode & _PROPERTIES else ():
        waveform.attributes[name].string_value = text
    if not mode & _TIMING:
        return
    seconds = system.clock.now()
    if task.timed:
        waveform.dt = 1 / task.clock.rate_hz
        seconds = (task.clock.start or 0.0) + (task.offset + result.first) / task.clock.rate_hz
    # A PrecisionTimestamp: seconds since 1904, and a fraction in units of 2^-64 s.
    when = system.epoch + timedelta(seconds=seconds)
    since = when - datetime(1904, 1, 1, tzinfo=when.tzinfo)
    waveform.t0.seconds = since.days * 86400 + since.seconds
    waveform.t0.fractional_seconds = int(since.microseconds / 1e6 * 2**64)


def _write_analog_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    matrix = np.array([list(waveform.y_data) for waveform in request.waveforms], dtype=np.float64)
    _refuse_count(task, len(matrix))
    return pb.WriteAnalogWaveformsResponse(samps_per_chan_written=put(system, task, matrix, request, alive))


def _write_digital_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    _refuse_count(task, len(request.waveforms))
    rows = []
    for channel, waveform in zip(task.channels, request.waveforms, strict=True):
        _refuse_lines(channel, waveform.signal_count)
        data = np.frombuffer(waveform.y_data, dtype=np.uint8).reshape(-1, waveform.signal_count)
        rows.append(data.T.astype(np.float64))
    written = put(system, task, np.concatenate(rows), request, alive)
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


TRANSFERS: dict[str, Call] = {
    **{f"Read{name}": _reader(name, form) for name, form in _FORMATS.items()},
    **{f"Write{name}": _writer(name, form) for name, form in _FORMATS.items()},
    "ReadAnalogScalarF64": _read_volts,
    "ReadDigitalScalarU32": _read_word,
    "ReadDigitalLines": _read_lines,
    "ReadRaw": _read_raw,
    "ReadAnalogWaveforms": _read_analog_waveforms,
    "ReadDigitalWaveforms": _read_digital_waveforms,
    "WriteAnalogScalarF64": _writer_of_one(pb.WriteAnalogScalarF64Response, _as_given),
    "WriteDigitalScalarU32": _writer_of_one(pb.WriteDigitalScalarU32Response, word_lines),
    "WriteDigitalLines": _write_lines,
    "WriteRaw": _write_raw,
    "WriteAnalogWaveforms": _write_analog_waveforms,
    "WriteDigitalWaveforms": _write_digital_waveforms,
}
"""Read and write calls that are served, by name."""
