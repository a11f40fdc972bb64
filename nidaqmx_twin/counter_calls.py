"""Read and write calls of counters, and the properties of their channels that their state decides."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import Level

from ..base.arrays import FloatArray
from .channel import Channel, counter_timebase, default_terminal, timebase_of
from .counters import INPUTS
from .errors import DaqmxError, DAQmxErrors, unsupported
from .names import flattened, is_by_scan
from .reading import Alive, Call, Taken, take, take_one
from .signalling import change_pulses, pulse_terminal
from .system import NiSystem
from .tasks import Task

_PAIRS = {
    "Freq": ("frequency", "duty_cycle"),
    "Time": ("high_time", "low_time"),
    "Ticks": ("high_ticks", "low_ticks"),
}
"""Fields of a pulse by the name of its calls."""
_NOT_RUNNING = {
    "Freq": DAQmxErrors.WRITE_WHEN_TASK_NOT_RUNNING_CO_FREQ,
    "Time": DAQmxErrors.WRITE_WHEN_TASK_NOT_RUNNING_CO_TIME,
    "Ticks": DAQmxErrors.WRITE_WHEN_TASK_NOT_RUNNING_CO_TICKS,
}


def _take(system: NiSystem, request: Any, alive: Alive, take: Callable[..., Taken] = take) -> Taken:
    task = system.task(request.task.name)
    if task.channels and task.kind != "ci":
        raise DaqmxError(
            DAQmxErrors.READ_NO_INPUT_CHANS_IN_TASK,
            f"Read cannot be performed, because task {task.name!r} has no counter inputs.",
        )
    return take(system, request, alive)


def _scaled(taken: Taken) -> FloatArray:
    return np.array([
        row if channel.custom is None else channel.custom.to_units(row)
        for channel, row in zip(taken.channels, taken.rows[::2], strict=True)
    ]).reshape(len(taken.channels), taken.count)  # fmt: skip


def _reader(name: str, whole: bool) -> Call:
    reply = getattr(pb, f"Read{name}Response")

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        taken = _take(system, request, alive)
        rows = taken.rows[::2] if whole else _scaled(taken)
        flat = flattened(rows, request)
        answer = reply(status=taken.status, samps_per_chan_read=taken.count)
        answer.read_array.extend(flat.astype(np.int64).tolist() if whole else flat.tolist())
        return answer

    return call


def _reader_of_one(name: str, whole: bool) -> Call:
    reply = getattr(pb, f"Read{name}Response")

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        taken = _take(system, request, alive, take_one)
        return reply(value=int(taken.rows[0, 0]) if whole else float(_scaled(taken)[0, 0]))

    return call


def _pair_reader(name: str) -> Call:
    reply, fields = getattr(pb, f"ReadCtr{name}Response"), _PAIRS[name]

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        taken = _take(system, request, alive)
        answer = reply(status=taken.status, samps_per_chan_read=taken.count)
        for place, of in enumerate(fields):
            flat = flattened(taken.rows[place::2], request, "interleaved")
            getattr(answer, f"read_array_{of}").extend(_numbers(name, flat))
        return answer

    return call


def _pair_reader_of_one(name: str) -> Call:
    reply, fields = getattr(pb, f"ReadCtr{name}ScalarResponse"), _PAIRS[name]

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        taken = _take(system, request, alive, take_one)
        return reply(**{of: _numbers(name, taken.rows[place])[0] for place, of in enumerate(fields)})

    return call


def _numbers(name: str, values: FloatArray) -> list[Any]:
    return [round(value) for value in values] if name == "Ticks" else values.tolist()


# Pulses to be put out


def _spans(
    name: str, channel: Channel, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the high and low times (s) of pulses that a call gives in its own way."""
    if name == "Freq":
        return second / first, (1 - second) / first
    if name == "Ticks":
        hz = timebase_of(channel, counter_timebase(channel.product.family))
        return first / hz, second / hz
    return first, second


def _pair_writer(name: str) -> Call:
    reply, fields = getattr(pb, f"WriteCtr{name}Response"), _PAIRS[name]

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        channels = len(task.channels)
        given = [np.array(list(getattr(request, of)), np.float64) for of in fields]
        by_scan = is_by_scan(request, "data_layout")
        rows = [part.reshape(-1, channels).T if by_scan else part.reshape(channels, -1) for part in given]
        _put(system, task, name, rows, request.auto_start)
        return reply(num_samps_per_chan_written=int(rows[0].shape[1]))

    return call


def _pair_writer_of_one(name: str) -> Call:
    reply, fields = getattr(pb, f"WriteCtr{name}ScalarResponse"), _PAIRS[name]

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        rows = [np.full((len(task.channels), 1), float(getattr(request, of))) for of in fields]
        _put(system, task, name, rows, request.auto_start)
        return reply()

    return call


def _put(system: NiSystem, task: Task, name: str, rows: list[FloatArray], auto_start: bool) -> None:
    if task.kind != "co":
        raise DaqmxError(
            DAQmxErrors.WRITE_NO_OUTPUT_CHANS_IN_TASK,
            f"Write cannot be performed, because task {task.name!r} has no counter outputs.",
        )
    if task.running and task.timed and task.total is not None and task.implicit:
        raise DaqmxError(
            DAQmxErrors.CANNOT_WRITE_TO_FINITE_CO_TASK,
            f"Write cannot be performed while the finite pulse train of {task.name!r} is put out.",
        )
    if not task.running and not task.timed and not auto_start:
        raise DaqmxError(
            _NOT_RUNNING[name],
            f"Write cannot be performed while {task.name!r} is not running, because it has no buffer: start "
            "it, or let the write start it.",
        )
    spans = [_spans(name, channel, *pair) for channel, *pair in zip(task.channels, *rows, strict=True)]
    high, low = (np.array([pair[place] for pair in spans]) for place in (0, 1))
    if not (np.isfinite(high + low).all() and (high > 0).all() and (low > 0).all()):
        raise unsupported("a pulse has a high and a low part.")
    task.written += high.shape[1]
    if task.running:
        change_pulses(system.terminals, task, system.clock.now(), (high, low))
    else:
        task.pulses = (high, low)
        if auto_start:
            system.start(task, auto=True)
    system.changed.notify_all()


COUNTING: dict[str, Call] = {
    **{f"Read{name}": _reader(name, whole=False) for name in ("CounterF64", "CounterF64Ex")},
    **{f"Read{name}": _reader(name, whole=True) for name in ("CounterU32", "CounterU32Ex")},
    "ReadCounterScalarF64": _reader_of_one("CounterScalarF64", whole=False),
    "ReadCounterScalarU32": _reader_of_one("CounterScalarU32", whole=True),
    **{f"ReadCtr{name}": _pair_reader(name) for name in _PAIRS},
    **{f"ReadCtr{name}Scalar": _pair_reader_of_one(name) for name in _PAIRS},
    **{f"WriteCtr{name}": _pair_writer(name) for name in _PAIRS},
    **{f"WriteCtr{name}Scalar": _pair_writer_of_one(name) for name in _PAIRS},
}
"""Read and write calls of counters that are served, by name."""


# Properties of counter channels that their state decides, and the terminals that they have by default.


def socket_of(channel: Channel, name: str) -> str | None:
    """Return the default terminal of the input that property `name` is about; None if it is not known."""
    own = INPUTS.get(int(channel.values.get("CI_MEAS_TYPE", 0)))
    if own is not None and name == own.term:
        return default_terminal(channel, own.at(channel.values))
    if "_B_INPUT" in name or name.endswith(("DIR_TERM", "SEP_FIRST_TERM")):
        return default_terminal(channel, "aux")
    if "_Z_INPUT" in name or name.endswith(("SEP_SECOND_TERM", "GATE_TERM")):
        return default_terminal(channel, "gate")
    return default_terminal(channel, "source") if name.endswith("_TERM") else None


def _count(system: NiSystem, task: Task, channel: Channel) -> int:
    if not task.meters:
        return int(channel.values.get("CI_COUNT_EDGES_INITIAL_CNT", 0))
    meter, now = task.meters[task.channels.index(channel)], system.clock.now()
    if meter.silent or not meter.counts:
        return 0
    meter.advance(now)
    return int(meter.at(np.array([now]))[0])


def _is_done(system: NiSystem, task: Task, channel: Channel) -> bool:
    return task.done(system.clock.now())


def _state(system: NiSystem, task: Task, channel: Channel) -> int:
    idle = channel.values.get("CO_PULSE_IDLE_STATE", Level.LOW.value) == Level.HIGH.value
    level = idle
    if task.trains:
        train, now = task.trains[task.channels.index(channel)], system.clock.now()
        changes = train.transitions(now - 2 * train.cycle, now)
        level = bool(changes.levels[-1]) if len(changes.levels) else idle
    return int((Level.HIGH if level else Level.LOW).value)


def _timebase(system: NiSystem, task: Task, channel: Channel) -> float:
    return timebase_of(channel, counter_timebase(channel.product.family))


COUNTER_FACTS: dict[str, Callable[[NiSystem, Task, Channel], Any]] = {
    "CI_COUNT": _count,
    "CI_CTR_TIMEBASE_RATE": _timebase,
    "CO_CTR_TIMEBASE_RATE": _timebase,
    "CO_PULSE_DONE": _is_done,
    "CO_OUTPUT_STATE": _state,
    "CO_COUNT": lambda s, t, ch: t.count(s.clock.now()),
    "CO_PULSE_TERM": lambda s, t, ch: pulse_terminal(ch),
    "CO_RDY_FOR_NEW_VAL": lambda s, t, ch: True,
}
"""Properties by NI's names."""
