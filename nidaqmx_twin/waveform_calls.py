"""Read and write calls of waveforms: samples with their channels' names and times."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as pb

from .channel import Channel
from .errors import DaqmxError, DAQmxErrors
from .names import field
from .reading import Alive, Call, Taken, take
from .system import NiSystem
from .tasks import Task
from .writing import put

_TIMING, _PROPERTIES = 1, 2
"""Bits of NI's WaveformAttributeMode, which older clients lack."""


def _read_analog_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    result = take(system, request, alive)
    answer = pb.ReadAnalogWaveformsResponse(status=result.status, samps_per_chan_read=result.count)
    for channel, row in zip(result.channels, result.scaled, strict=True):
        waveform = answer.waveforms.add()
        waveform.y_data.extend(row.tolist())
        _describe(system, request, result, waveform, NI_ChannelName=channel.name, NI_UnitDescription="Volts")
    return answer


def _read_digital_waveforms(system: NiSystem, request: Any, alive: Alive) -> Any:
    result = take(system, request, alive)
    answer = pb.ReadDigitalWaveformsResponse(status=result.status, samps_per_chan_read=result.count)
    for channel, mine in result.lines():
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


WAVEFORMS: dict[str, Call] = {
    "ReadAnalogWaveforms": _read_analog_waveforms,
    "ReadDigitalWaveforms": _read_digital_waveforms,
    "WriteAnalogWaveforms": _write_analog_waveforms,
    "WriteDigitalWaveforms": _write_digital_waveforms,
}
"""Calls of this module, by name."""
