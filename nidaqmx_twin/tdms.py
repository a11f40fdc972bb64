"""Logging of acquired samples to a TDMS file, NI's own format.

A file is a row of segments. Each begins with "TDSm", flags of what it holds, the version and two lengths;
then come the objects (file, group, channels) with their properties, and the channels' samples one after the
other.
(ni.com, "TDMS File Format Internal Structure".)
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from nidaqmx.constants import LoggingMode, LoggingOperation

from ..base.arrays import FloatArray
from . import inputs
from .errors import DaqmxError, DAQmxErrors
from .system import NiSystem
from .tasks import Task

_MAGIC = b"TDSm"
_FLAGS = 1 << 1 | 1 << 2 | 1 << 3
"""The segment has objects, they are a new list, and raw data."""
_VERSION = 4713
_WHOLE, _DOUBLE, _STRING, _TIME = 3, 10, 0x20, 0x44
_NO_DATA = 0xFFFFFFFF
_FAILED = object()


def segment(
    group: str, channels: Mapping[str, FloatArray], properties: Mapping[str, float | str | datetime]
) -> bytes:
    """Return one segment: the samples of `channels` (samples,) by name, with `properties` of each channel."""
    objects = [_object("/", {}, None), _object(f"/{_quoted(group)}", {}, None)]
    for name, samples in channels.items():
        told = {"NI_ChannelName": name, **properties}
        objects.append(_object(f"/{_quoted(group)}/{_quoted(name)}", told, len(samples)))
    head = struct.pack("<I", len(objects)) + b"".join(objects)
    data = b"".join(samples.astype("<f8").tobytes() for samples in channels.values())
    return _MAGIC + struct.pack("<IIQQ", _FLAGS, _VERSION, len(head) + len(data), len(head)) + head + data


def _quoted(name: str) -> str:
    doubled = name.replace("'", "''")
    return f"'{doubled}'"


def _text(value: str) -> bytes:
    encoded = value.encode()
    return struct.pack("<I", len(encoded)) + encoded


def _object(path: str, properties: Mapping[str, float | str | datetime], count: int | None) -> bytes:
    index = struct.pack("<I", _NO_DATA)
    if count is not None:
        index = struct.pack("<IIIQ", 20, _DOUBLE, 1, count)
    told = [_text(name) + _value(value) for name, value in properties.items()]
    return _text(path) + index + struct.pack("<I", len(told)) + b"".join(told)


def _value(value: float | str | datetime) -> bytes:
    if isinstance(value, str):
        return struct.pack("<I", _STRING) + _text(value)
    if isinstance(value, datetime):
        since = value - datetime(1904, 1, 1, tzinfo=value.tzinfo)
        fraction = int(since.microseconds / 1e6 * 2**64)
        return struct.pack("<IQq", _TIME, fraction, since.days * 86400 + since.seconds)
    if isinstance(value, int):
        return struct.pack("<Ii", _WHOLE, value)
    return struct.pack("<Id", _DOUBLE, value)


def log(system: NiSystem, task: Task) -> None:
    """Write what a task has acquired since it was last called to the file that it logs to, if it logs.

    Raises DaqmxError, once a run, where the file cannot be written or where one that is no TDMS file stands.
    """
    if task.log_path is _FAILED:
        return
    try:
        _log(system, task)
    except DaqmxError:
        task.log_path = _FAILED
        raise


def _log(system: NiSystem, task: Task) -> None:
    mode = task.setting("Read", "LOGGING_MODE", LoggingMode.OFF.value)
    if mode == LoggingMode.OFF.value or not task.running:
        return
    if task.setting("Read", "LOGGING_PAUSE", False):
        task.logged = task.count(system.clock.now())
        return
    path = Path(task.folder, str(task.setting("Read", "LOGGING_FILE_PATH", "")))
    first, last = task.logged, task.count(system.clock.now())
    if mode == LoggingMode.LOG_AND_READ.value:  # "you must read samples for NI-DAQmx to stream them to disk"
        last = min(last, task.read_position)
    if task.log_path != path:
        _begin(
            path, int(task.setting("Read", "LOGGING_TDMS_OPERATION", LoggingOperation.OPEN_OR_CREATE.value))
        )
        task.log_path = path
    if last <= first:
        return
    rows = inputs.samples(system, task, first, last - first)
    when = system.epoch + timedelta(seconds=(task.clock.start or 0.0) + first / task.clock.rate_hz)
    properties: dict[str, float | str | datetime] = {
        # As a PCI-6133's file has them (juliancabaleiro/nidaqmx-python-examples, TDMS_co_trigger.py).
        "unit_string": "Volts",
        "NI_UnitDescription": "Volts",
        "wf_increment": 1 / task.clock.rate_hz,
        "wf_start_time": when,
        "wf_start_offset": 0.0,
        "wf_samples": 1,
    }
    group = str(task.setting("Read", "LOGGING_TDMS_GROUP_NAME", "") or task.name)
    written = segment(group, dict(zip(_names(task), _scaled(task, rows), strict=True)), properties)
    try:
        with path.open("ab") as file:
            file.write(written)
    except OSError as error:
        raise _refused(path, error) from None
    task.logged = last


def _names(task: Task) -> Sequence[str]:
    return [channel.name for channel in task.channels]


def _scaled(task: Task, rows: FloatArray) -> list[FloatArray]:
    return [
        np.asarray(row if channel.scale is None else channel.scale.to_units(row))
        for channel, row in zip(task.channels, rows, strict=True)
    ]


def _begin(path: Path, operation: int) -> None:
    """Open or make a log file as asked; only one that is a TDMS file is ever replaced or continued."""
    exists = path.exists()
    create = operation in (LoggingOperation.CREATE.value, LoggingOperation.CREATE_OR_REPLACE.value)
    if not path.name or path.suffix.lower() != ".tdms":
        raise DaqmxError(
            DAQmxErrors.FILE_PATH_INVALID, f"A log file's name ends in .tdms, not {path.name!r}."
        )
    if exists and operation == LoggingOperation.CREATE.value:
        raise DaqmxError(DAQmxErrors.GENERIC_FILE_IO, f"{str(path)!r} exists already.")
    if not exists and operation == LoggingOperation.OPEN.value:
        raise DaqmxError(DAQmxErrors.TDMS_NOT_FOUND, f"{str(path)!r} does not exist.")
    try:
        if exists and path.read_bytes()[:4] not in (b"", _MAGIC):
            raise DaqmxError(DAQmxErrors.GENERIC_FILE_IO, f"{str(path)!r} is not a TDMS file.")
        if create or not exists:
            path.write_bytes(b"")
    except OSError as error:
        raise _refused(path, error) from None


def _refused(path: Path, error: OSError) -> DaqmxError:
    return DaqmxError(DAQmxErrors.GENERIC_FILE_IO, f"{str(path)!r} cannot be written: {error.strerror}.")
