"""Reading of power channels: a simulated supply gives what it is set to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as pb

from ..base.arrays import FloatArray
from .channel import Channel
from .errors import DaqmxError, DAQmxErrors
from .fields import flattened
from .system import NiSystem
from .taking import Alive, Call, take
from .tasks import Task

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


def _reader(name: str, coded: bool) -> Call:
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
    "ReadPowerF64": _reader("PowerF64", coded=False),
    "ReadPowerBinaryI16": _reader("PowerBinaryI16", coded=True),
    "ReadPowerScalarF64": _read_one,
}
"""Calls of this module, by name."""
