"""Properties that programs read, set and reset: about 160 calls, served by one function.

A property that describes the state is computed; any other has the value that the program set, or its
default. A property without any of these fails and is counted, because a guessed answer would make the
simulator untrustworthy.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from nidaqmx import constants as c
from nidaqmx.utils import unflatten_channel_string

from .defaults import default_value
from .errors import DaqmxError, DAQmxErrors
from .facts import CHANNEL_FACTS, DEVICE_FACTS, SYSTEM_FACTS
from .keeping import read_kept, write_kept
from .putting import space
from .system import NiSystem
from .tasks import Channel, Task

__all__ = ["ATTRIBUTE_CALL", "serve"]

ATTRIBUTE_CALL = re.compile(
    r"(?P<verb>Get|Set|Reset)(?P<kind>Chan|Timing|Trig|Read|Write|Buffer|ExportedSignal|Device|PhysicalChan"
    r"|SystemInfo|Task|Scale|PersistedScale|PersistedTask|Watchdog)Attribute(?P<ex>Ex)?(?P<type>\w*)"
)
"""Pattern of the names of the calls that `serve` handles."""

_KEPT = ("Scale", "PersistedScale", "PersistedTask", "Watchdog")


def serve(system: NiSystem, match: re.Match[str], request: Any, reply: Any) -> None:
    """Serve one property call and fill `reply`; `match` is the call's name matched by `ATTRIBUTE_CALL`."""
    verb, kind, type_ = match["verb"], match["kind"], match["type"]
    name = _attribute_name(system, match[0], request)
    if match["ex"] and request.device_names and not name.startswith("AI_CONV"):
        raise DaqmxError(
            DAQmxErrors.M_STUDIO_OPERATION_DOES_NOT_SUPPORT_DEVICE_CONTEXT,
            f"Property {name} does not support device context: read it of the task.",
        )
    if kind in _KEPT and verb != "Get":
        write_kept(system, kind, name, request, _value(request, type_) if verb == "Set" else None)
        return
    if verb == "Get":
        _answer(reply, type_, _get(system, kind, type_, name, request))
        return
    task = system.task(request.task.name)
    if kind in ("Chan", "Timing", "Trig") and task.running:
        raise DaqmxError(
            DAQmxErrors.CANNOT_SET_PROPERTY_WHEN_TASK_RUNNING,
            f"Specified property cannot be set while the task is running: {name}.",
        )
    if kind == "Trig":
        _refuse_trigger(task, name)
    if kind == "Buffer" and name.startswith("INPUT") is not task.is_input:
        raise DaqmxError(
            DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT,
            f"Specified property is not supported by the channels of {task.name!r}: {name}.",
        )
    if kind in ("Chan", "Timing", "Trig", "Buffer"):
        system.changed_properties(task)
    stores: list[dict[Any, Any]] = [task.settings]
    key: Any = (kind, name)
    if kind == "Chan":
        stores, key = [channel.values for channel in _channels(task, request.channel)], name
    for store in stores:
        if verb == "Set":
            store[key] = _value(request, type_)
        else:
            store.pop(key, None)
    if verb == "Set" and name == "SAMP_CLK_RATE":
        task.settings.pop(("Timing", "SAMP_CLK_TIMEBASE_DIV"), None)


def _refuse_trigger(task: Task, name: str) -> None:
    """Refuse reference triggers of outputs, and handshake and advance triggers of counters."""
    foreign = {"co": ("REF_", "HSHK_", "ADV_"), "ao": ("REF_",), "do": ("REF_",)}.get(task.kind, ())
    if any(f"_{mark}TRIG" in f"_{name}" for mark in foreign):
        raise DaqmxError(
            DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT,
            f"Specified property is not supported by the channels of {task.name!r}: {name}.",
        )


def _attribute_name(system: NiSystem, call: str, request: Any) -> str:
    enum = request.DESCRIPTOR.fields_by_name["attribute"].enum_type
    number = request.attribute_raw or request.attribute
    value = enum.values_by_number.get(number)
    if value is None:
        system.unserved[f"{call} {number:#x}"] += 1
        raise DaqmxError(DAQmxErrors.ATTR_NOT_SUPPORTED, f"{call}: there is no property {number:#x}.")
    return str(value.name).partition("ATTRIBUTE_")[2]


def _value(request: Any, type_: str) -> Any:
    fields = request.DESCRIPTOR.fields_by_name
    if "value_raw" in fields:
        raw = request.value_raw
        value = raw or request.value
    else:
        value = request.value
    if type_ == "Timestamp":
        return value.ToDatetime(tzinfo=UTC)
    return list(value) if type_.endswith("Array") else value


def _answer(reply: Any, type_: str, value: Any) -> None:
    target = "value_raw" if "value_raw" in reply.DESCRIPTOR.fields_by_name else "value"
    if type_ == "Timestamp":
        reply.value.FromDatetime(value)
    elif type_.endswith("Array"):
        getattr(reply, target).extend(value)
    elif type_ == "Int32":
        # A bit-field property is a list of one element here.
        found = getattr(reply, target)
        if isinstance(found, int):
            setattr(reply, target, int(value))
        else:
            found.append(int(value))
    else:
        setattr(reply, target, value)


def _get(system: NiSystem, kind: str, type_: str, name: str, request: Any) -> Any:
    if kind in ("Device", "SystemInfo", "PhysicalChan"):
        return _fact(system, kind, name, request)
    if kind in _KEPT:
        kept = read_kept(system, kind, name, request)
        if kept is None:
            raise _unserved(system, kind, name)
        return kept
    task = system.task(request.task.name)
    if kind == "Chan":
        channel = _channels(task, request.channel)[0]
        if name in _CHANNEL:
            return _CHANNEL[name](channel)
        value = channel.values.get(name)
    elif name in _TASK.get(kind, {}):
        return _TASK[kind][name](system, task)
    else:
        value = task.setting(kind, name)
    if value is None:
        value = _default(system, kind, type_, name)
    elif re.fullmatch(r"(ANLG_(EDGE|WIN|LVL)|DIG_EDGE|DIG_LVL)_\w*_TRIG_SRC", name) and value:
        value = system.inventory.written(task.device, value)
    return value


def _fact(system: NiSystem, kind: str, name: str, request: Any) -> Any:
    """Return a property that does not depend on a task."""
    if kind == "Device":
        device = system.inventory.device(request.device_name)
        if name in DEVICE_FACTS:
            return DEVICE_FACTS[name](system.inventory, device)
    elif kind == "PhysicalChan":
        ((device, tail),) = system.inventory.resolve(request.physical_channel)
        if name in CHANNEL_FACTS:
            return CHANNEL_FACTS[name](device, tail)
    elif name in SYSTEM_FACTS:
        return SYSTEM_FACTS[name](system)
    raise _unserved(system, kind, name)


def _default(system: NiSystem, kind: str, type_: str, name: str) -> Any:
    value = default_value(kind, type_, name)
    if value is None:
        raise _unserved(system, kind, name)
    return value


def _unserved(system: NiSystem, kind: str, name: str) -> DaqmxError:
    system.unserved[f"{kind} {name}"] += 1
    return DaqmxError(
        DAQmxErrors.ATTR_NOT_SUPPORTED,
        f"Specified property is not supported: haploop's NI wire does not know {name} ({kind}).",
    )


def _channels(task: Task, names: str) -> list[Channel]:
    _ = task.kind
    if not names:
        return task.channels
    known = {channel.name.lower(): channel for channel in task.channels}
    wanted = [names] if names.lower() in known else unflatten_channel_string(names)
    try:
        return [known[name.strip().lower()] for name in wanted]
    except KeyError as missing:
        raise DaqmxError(
            DAQmxErrors.LAB_VIEW_INVALID_TASK_OR_CHANS,
            f"The task {task.name!r} has no channel {missing.args[0]!r}.",
        ) from None


# Properties that describe the state

_CHANNEL_TYPE = {
    "ai": c.ChannelType.ANALOG_INPUT,
    "ao": c.ChannelType.ANALOG_OUTPUT,
    "di": c.ChannelType.DIGITAL_INPUT,
    "do": c.ChannelType.DIGITAL_OUTPUT,
    "ci": c.ChannelType.COUNTER_INPUT,
    "co": c.ChannelType.COUNTER_OUTPUT,
}


def _limit(sign: int) -> Callable[[Channel], float]:
    def limit(channel: Channel) -> float:
        name, missing = (
            ("AI_MAX", DAQmxErrors.AI_MAX_NOT_SPECIFIED)
            if sign > 0
            else ("AI_MIN", DAQmxErrors.AI_MIN_NOT_SPECIFIED)
        )
        if name not in channel.values:
            raise DaqmxError(missing, f"{name} of {channel.name!r} was reset and has not been set since.")
        if channel.values.get("AI_MEAS_TYPE_NAME") != "VOLTAGE":
            return channel.high if sign > 0 else channel.low
        # The driver reports the limits of the range that it chose, which contains the requested one.
        ends = np.array([-channel.full_scale, channel.full_scale])
        if channel.scale is not None:
            ends = channel.scale.to_units(ends)
        return float(ends.max() if sign > 0 else ends.min())

    return limit


_CHANNEL: dict[str, Callable[[Channel], Any]] = {
    "CHAN_TYPE": lambda ch: _CHANNEL_TYPE[ch.kind].value,
    "PHYSICAL_CHAN_NAME": lambda ch: ", ".join(
        f"{ch.device.name}/{p}"
        for p in (dict.fromkeys(p.partition("/")[0] for p in ch.physical) if ch.ports else ch.physical)
    ),
    "AI_MAX": _limit(1),
    "AI_MIN": _limit(-1),
    "AI_RNG_HIGH": lambda ch: ch.full_scale,
    "AI_RNG_LOW": lambda ch: -ch.full_scale,
    "AI_RESOLUTION": lambda ch: float(ch.product.ai_bits),
    "AI_RAW_SAMP_SIZE": lambda ch: 16,
    "AI_DEV_SCALING_COEFF": lambda ch: [0.0, ch.width],
    "AO_MAX": lambda ch: ch.high,
    "AO_MIN": lambda ch: ch.low,
    "AO_DAC_RNG_HIGH": lambda ch: ch.full_scale,
    "AO_DAC_RNG_LOW": lambda ch: -ch.full_scale,
    "AO_RESOLUTION": lambda ch: float(ch.product.ao_bits),
    "AO_DEV_SCALING_COEFF": lambda ch: [0.0, 1 / ch.width],
    "DI_NUM_LINES": lambda ch: len(ch.physical),
    "DO_NUM_LINES": lambda ch: len(ch.physical),
}


def _samples_asked(system: NiSystem, task: Task) -> int:
    if task.timed and task.total is not None:
        task.verify()
    return task.samples_asked


def _clock_source(system: NiSystem, task: Task) -> str:
    source = task.setting("Timing", "SAMP_CLK_SRC", "")
    device = task.device
    return (
        system.inventory.written(device, source)
        if source
        else f"/{device.name}/{task.kind}/SampleClockTimebase"
    )


def _max_rate(task: Task) -> float:
    product, channels = task.device.product, len(task.channels)
    if task.kind == "ao":
        return product.ao_rate_hz
    if channels == 1 or product.ai_simultaneous:
        return product.ai_rate_single_hz
    return product.ai_rate_hz / channels


def _conversion_rate(system: NiSystem, task: Task) -> float:
    asked = task.setting("Timing", "AI_CONV_RATE")
    if asked:
        return float(asked)
    interval = task.interval
    return 1 / interval if interval else task.rate_hz


def _conversion_divisor(system: NiSystem, task: Task) -> int:
    asked = task.setting("Timing", "AI_CONV_TIMEBASE_DIV")
    if asked:
        return int(asked)
    if task.device.product.family == "C Series":
        # A real NI 9205 reports padding for a single channel too, and its divisor is one larger.
        return int(task.timebase_hz * (1 / task.device.product.ai_rate_hz + 10e-6) + 0.5) + 1
    return round(task.timebase_hz * task.interval)


def _clock_name(source: str) -> Callable[[NiSystem, Task], str]:
    return lambda _s, task: f"/{task.device.name}/{task.kind}/{source}"


def _line_bytes(_system: NiSystem, task: Task) -> int:
    return max(len(channel.physical) for channel in task.channels)


def _raw_width(_system: NiSystem, task: Task) -> int:
    if task.kind in ("ai", "ao"):
        return 2
    widest = max(task.device.product.ports)
    return 4 if widest > 16 else 1


def _start_time(system: NiSystem, task: Task) -> datetime:
    return system.epoch + timedelta(seconds=task.clock.start or 0.0)


_TASK: dict[str, dict[str, Callable[[NiSystem, Task], Any]]] = {
    "Task": {
        "NAME": lambda s, t: t.name,
        "CHANNELS": lambda s, t: ", ".join(channel.name for channel in t.channels),
        "DEVICES": lambda s, t: ", ".join(d.name for d in t.devices) if t.channels else "",
        "NUM_CHANS": lambda s, t: len(t.channels),
        "NUM_DEVICES": lambda s, t: len(t.devices) if t.channels else 0,
        "COMPLETE": lambda s, t: t.done(s.clock.now()),
    },
    "Timing": {
        "SAMP_CLK_RATE": lambda s, t: t.rate_hz,
        "SAMP_CLK_MAX_RATE": lambda s, t: _max_rate(t),
        "SAMP_CLK_TIMEBASE_RATE": lambda s, t: t.timebase_hz,
        "SAMP_CLK_TIMEBASE_DIV": lambda s, t: round(t.timebase_hz / t.rate_hz),
        "SAMP_CLK_TIMEBASE_SRC": lambda s, t: f"/{t.device.name}/{t.timebase_hz / 1e6:g}MHzTimebase",
        "SAMP_CLK_SRC": _clock_source,
        "SAMP_CLK_TERM": _clock_name("SampleClock"),
        "SAMP_CLK_TIMEBASE_TERM": _clock_name("SampleClockTimebase"),
        "SAMP_QUANT_SAMP_PER_CHAN": _samples_asked,
        "AI_CONV_RATE": _conversion_rate,
        "AI_CONV_MAX_RATE": lambda s, t: t.device.product.ai_rate_hz,
        "AI_CONV_TIMEBASE_DIV": _conversion_divisor,
        "AI_CONV_SRC": _clock_name("ConvertClockTimebase"),
        "FIRST_SAMP_TIMESTAMP_VAL": _start_time,
    },
    "Trig": {
        "START_TRIG_TERM": _clock_name("StartTrigger"),
        "REF_TRIG_TERM": _clock_name("ReferenceTrigger"),
        "PAUSE_TRIG_TERM": _clock_name("PauseTrigger"),
        "START_TRIG_TIMESTAMP_VAL": _start_time,
        "REF_TRIG_TIMESTAMP_VAL": _start_time,
    },
    "Read": {
        "CHANNELS_TO_READ": lambda s, t: t.setting(
            "Read", "CHANNELS_TO_READ", ", ".join(channel.name for channel in t.channels)
        ),
        "NUM_CHANS": lambda s, t: len(t.channels),
        "AVAIL_SAMP_PER_CHAN": lambda s, t: max(0, t.count(s.clock.now()) - t.read_position),
        "CURR_READ_POS": lambda s, t: t.read_position,
        "TOTAL_SAMP_PER_CHAN_ACQUIRED": lambda s, t: t.count(s.clock.now()),
        "RAW_DATA_WIDTH": _raw_width,
        "DIGITAL_LINES_BYTES_PER_CHAN": _line_bytes,
        "OVERLOADED_CHANS_EXIST": lambda s, t: bool(t.overloaded),
        "OVERLOADED_CHANS": lambda s, t: ", ".join(dict.fromkeys(t.overloaded)),
    },
    "Write": {
        "NUM_CHANS": lambda s, t: len(t.channels),
        "CURR_WRITE_POS": lambda s, t: t.written,
        "TOTAL_SAMP_PER_CHAN_GENERATED": lambda s, t: t.count(s.clock.now()),
        "SPACE_AVAIL": space,
        "RAW_DATA_WIDTH": _raw_width,
        "DIGITAL_LINES_BYTES_PER_CHAN": _line_bytes,
    },
    "Buffer": {
        "INPUT_BUF_SIZE": lambda s, t: t.buffer_size if t.timed else 0,
        "OUTPUT_BUF_SIZE": lambda s, t: t.buffer_size,
        "INPUT_ONBRD_BUF_SIZE": lambda s, t: t.setting(
            "Buffer", "INPUT_ONBRD_BUF_SIZE", t.device.product.ai_fifo
        ),
        "OUTPUT_ONBRD_BUF_SIZE": lambda s, t: t.setting(
            "Buffer", "OUTPUT_ONBRD_BUF_SIZE", t.device.product.ao_fifo
        ),
    },
}
