"""Read and write calls, side by side: each transfers samples in its own format; lines and power too.

A task holds (rows, samples): volts of its analog channels, or 0 and 1 of its digital lines. `take` and `put`
wait for samples and for space; here they are brought into the arrays of the calls, and out of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as pb

from ..base.arrays import FloatArray
from .channel import Channel
from .errors import DaqmxError, DAQmxErrors
from .names import flattened, is_by_scan
from .reading import Alive, Call, Taken, take, take_one
from .system import NiSystem
from .tasks import Task
from .writing import put

# Formats of digital lines in the driver's calls: words of a port, and lines in rising order.


def port_words(channels: Sequence[Channel], rows: Any) -> Any:
    """Pack (lines, samples) bool into (channels, samples) words: bit i is line i; higher ports follow."""
    words, row = [], 0
    for channel in channels:
        bits = _bits(channel)
        mine = rows[row : row + len(bits)].astype(np.uint32)
        words.append((mine << np.array(bits, dtype=np.uint32)[:, np.newaxis]).sum(axis=0, dtype=np.uint32))
        row += len(bits)
    return np.array(words, dtype=np.uint32)


def word_lines(channels: Sequence[Channel], words: Any) -> FloatArray:
    """Unpack (channels, samples) words into (lines, samples) of 0 and 1: the reverse of `port_words`."""
    lines = []
    for channel, row in zip(channels, words, strict=True):
        lines += [(np.asarray(row, dtype=np.int64) >> bit) & 1 for bit in _bits(channel)]
    return np.array(lines, dtype=np.float64)


def _bits(channel: Channel) -> list[int]:
    base, bases = 0, {}
    for port in sorted({line.partition("/")[0] for line in channel.physical}):
        bases[port] = base
        base += channel.product.ports[int(port.removeprefix("port"))]
    return [bases[p] + int(n) for p, _, n in (line.partition("/line") for line in channel.physical)]


def line_order(channel: Channel) -> list[int]:
    """Return the order of a channel's lines in the driver's arrays: rising, independent of their naming."""
    bits = _bits(channel)
    return sorted(range(len(bits)), key=bits.__getitem__)


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
    "AnalogF64": _Format(lambda read: read.scaled, _as_given, _pack_doubles, _parse(np.float64)),
    "BinaryI16": _SIGNED,
    "BinaryI32": _SIGNED,
    "BinaryU16": _unsigned(16),
    "BinaryU32": _unsigned(32),
    "DigitalU8": _Format(_words, word_lines, _pack_octets, _parse_octets),
    "DigitalU16": _PORTS,
    "DigitalU32": _PORTS,
}


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
        result = take(system, request, alive)
        rows = form.read(result)
        _refuse_small(request.array_size_in_samps, rows.size)
        answer = reply(status=result.status, samps_per_chan_read=result.count)
        packed = form.pack(answer, flattened(rows, request))
        return answer if packed is None else answer.SerializeToString() + packed

    return call


def _writer(name: str, form: _Format) -> Call:
    reply = getattr(pb, f"Write{name}Response")

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        _ = task.kind
        flat, channels = np.asarray(form.parse(request)), len(task.channels)
        count = flat.size // channels
        by_scan = is_by_scan(request, "data_layout")
        matrix = flat.reshape(count, channels).T if by_scan else flat.reshape(channels, count)
        written = put(system, task, form.write(task.channels, matrix), request, alive)
        return reply(samps_per_chan_written=written)

    return call


# One sample


def _read_volts(system: NiSystem, request: Any, alive: Alive) -> Any:
    value = take_one(system, request, alive).scaled[0, 0]
    return pb.ReadAnalogScalarF64Response(value=float(value))


def _read_word(system: NiSystem, request: Any, alive: Alive) -> Any:
    return pb.ReadDigitalScalarU32Response(value=int(_words(take_one(system, request, alive))[0, 0]))


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
    result = take(system, request, alive, request.array_size_in_bytes // width)
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
    result = take(system, request, alive)
    width = max(len(channel.physical) for channel in result.channels)
    lines = np.zeros((len(result.channels), result.count, width), dtype=np.uint8)
    for index, (channel, mine) in enumerate(result.lines()):
        lines[index, :, : len(mine)] = mine[line_order(channel)].T
    if is_by_scan(request, "fill_mode"):
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
    if is_by_scan(request, "data_layout"):
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


TRANSFERS: dict[str, Call] = {
    **{f"Read{name}": _reader(name, form) for name, form in _FORMATS.items()},
    **{f"Write{name}": _writer(name, form) for name, form in _FORMATS.items()},
    "ReadAnalogScalarF64": _read_volts,
    "ReadDigitalScalarU32": _read_word,
    "ReadDigitalLines": _read_lines,
    "ReadRaw": _read_raw,
    "WriteAnalogScalarF64": _writer_of_one(pb.WriteAnalogScalarF64Response, _as_given),
    "WriteDigitalScalarU32": _writer_of_one(pb.WriteDigitalScalarU32Response, word_lines),
    "WriteDigitalLines": _write_lines,
    "WriteRaw": _write_raw,
}
"""Read and write calls that are served, by name."""


# Reading of power channels: a simulated supply gives what it is set to.

_CODES = (4096.0, 8192.0)
"""Codes per volt and per ampere (NI's own tests)."""


def _supplied(channels: Sequence[Channel], count: int) -> tuple[FloatArray, FloatArray]:
    """Return the volts and amperes (channels, count) that channels put out: their setpoints, NaN when off."""
    on = [bool(channel.values.get("PWR_OUTPUT_ENABLE")) for channel in channels]
    volts, amperes = (
        np.array([
            [float(channel.values.get(f"PWR_{of}_SETPOINT", 0.0)) if enabled else np.nan] * count
            for channel, enabled in zip(channels, on, strict=True)
        ]).reshape(-1, count)
        for of in ("VOLTAGE", "CURRENT")
    )  # fmt: skip
    return volts, amperes


def _refuse_mixed(task: Task) -> None:
    """Power is read of channels of power alone."""
    for channel in task.channels:
        if channel.values.get("AI_MEAS_TYPE_NAME") != "POWER":
            raise DaqmxError(
                DAQmxErrors.READ_CHAN_TYPE_MISMATCH,
                f"Read cannot be performed: {channel.name!r} of task {task.name!r} measures no power.",
                read=0,
            )


def _power_reader(name: str, coded: bool) -> Call:
    reply = getattr(pb, f"Read{name}Response")

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        _refuse_mixed(system.task(request.task.name))
        result = take(system, request, alive)
        answer = reply(status=result.status, samps_per_chan_read=result.count)
        targets = (answer.read_array_voltage, answer.read_array_current)
        for target, rows, codes in zip(
            targets, _supplied(result.channels, result.count), _CODES, strict=True
        ):
            flat = flattened(rows, request)
            target.extend(np.nan_to_num(flat * codes).astype(int).tolist() if coded else flat.tolist())
        return answer

    return call


def _read_one(system: NiSystem, request: Any, alive: Alive) -> Any:
    result = take(system, request, alive)
    volts, amperes = _supplied(result.channels, 1)
    return pb.ReadPowerScalarF64Response(voltage=float(volts[0, 0]), current=float(amperes[0, 0]))


POWER: dict[str, Call] = {
    "ReadPowerF64": _power_reader("PowerF64", coded=False),
    "ReadPowerBinaryI16": _power_reader("PowerBinaryI16", coded=True),
    "ReadPowerScalarF64": _read_one,
}
"""Calls of this module, by name."""
