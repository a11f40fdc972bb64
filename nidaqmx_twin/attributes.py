"""Properties that programs read, set and reset: about 160 calls, served by one function.

A property that describes the state is computed; any other has the value that the program set, or its
default. A property without any of these fails and is counted, because a guessed answer would make the
simulator untrustworthy.
"""

from __future__ import annotations

import re
from datetime import UTC
from typing import Any

from .channel import Channel
from .channels import refuse_input
from .counter_calls import COUNTER_FACTS, socket_of
from .errors import DaqmxError, DAQmxErrors, unserved
from .facts import CHANNEL_FACTS, DEVICE_FACTS, SYSTEM_FACTS
from .maintenance import read_kept, write_kept
from .names import names_in
from .properties import default_value
from .state_facts import CHANNEL_STATE, TASK_STATE
from .system import NiSystem
from .tasks import Task, refuse_rate
from .teds import sensed

ATTRIBUTE_CALL = re.compile(
    r"(?P<verb>Get|Set|Reset)(?P<kind>Chan|Timing|Trig|RealTime|Read|Write|Buffer|ExportedSignal|Device|PhysicalChan"
    r"|SystemInfo|Task|Scale|PersistedScale|PersistedTask|PersistedChan|CalInfo|Watchdog)Attribute(?P<ex>Ex)?(?P<type>\w*)"
)
"""Pattern of the names of the calls that `serve` handles."""

_KEPT = ("Scale", "PersistedScale", "PersistedTask", "PersistedChan", "CalInfo", "Watchdog")
_LOOKS = (
    "AVAIL_SAMP_PER_CHAN", "TOTAL_SAMP_PER_CHAN_ACQUIRED", "TOTAL_SAMP_PER_CHAN_GENERATED", "SPACE_AVAIL",
    "COMPLETE", "CI_COUNT", "CO_COUNT", "CO_OUTPUT_STATE", "CO_PULSE_DONE",
)  # fmt: skip
"""Properties at which a program looks to see how far a task is."""
_INTERNAL = {0x31E8: "DEFAULT_SAMPS_TO_READ"}
"""Properties that NI's client reads by number alone, of a driver from 24.5 on (seen in nidaqmx 1.7)."""


def serve(system: NiSystem, match: re.Match[str], request: Any, reply: Any) -> None:
    """Serve one property call and fill `reply`; `match` is the call's name matched by `ATTRIBUTE_CALL`."""
    verb, kind, type_ = match["verb"], match["kind"], match["type"]
    name = _attribute_name(system, match[0], request)
    if match["ex"] and request.device_names and not name.startswith("AI_CONV"):
        raise DaqmxError(
            DAQmxErrors.M_STUDIO_OPERATION_DOES_NOT_SUPPORT_DEVICE_CONTEXT,
            f"Property {name} does not support device context: read it of the task.",
        )
    if verb == "Get":
        _answer(reply, type_, _get(system, kind, type_, name, request))
        return
    given = _value(request, type_) if verb == "Set" else None
    if kind == "PhysicalChan":
        for device, tail in system.inventory.resolve(request.physical_channel):
            system.upkeep[f"{device.name}/{tail}", name] = given
    elif kind in _KEPT:
        write_kept(system, kind, name, request, given)
    else:
        _set(system, kind, name, request, given)


def _set(system: NiSystem, kind: str, name: str, request: Any, value: Any) -> None:
    """Set a property of a task or its channels; None resets it."""
    task = system.task(request.task.name)
    if kind in ("Chan", "Timing", "Trig") and task.running:
        raise DaqmxError(
            DAQmxErrors.CANNOT_SET_PROPERTY_WHEN_TASK_RUNNING,
            f"Specified property cannot be set while the task is running: {name}.",
        )
    _refuse_foreign(task, kind, name)
    if kind == "Timing":
        refuse_rate(name, value)
    if kind == "Chan" and value is not None:
        for channel in _channels(task, request.channel):
            refuse_input(channel.device, channel.physical[0], {name: value})
    if kind in ("Chan", "Timing", "Trig", "Buffer"):
        system.changed_properties(task)
    stores: list[dict[Any, Any]] = [task.settings]
    key: Any = (kind, name)
    if kind == "Chan":
        channels = _channels(task, request.channel)
        stores, key = [channel.values for channel in channels], name
        for channel in channels:
            channel.written.add(name)
    for store in stores:
        if value is not None:
            store[key] = value
        else:
            store.pop(key, None)
    if value is not None and name == "SAMP_CLK_RATE":
        task.settings.pop(("Timing", "SAMP_CLK_TIMEBASE_DIV"), None)


def _refuse_foreign(task: Task, kind: str, name: str) -> None:
    """Refuse the buffer of the other direction, and triggers that outputs and counters have not."""
    if kind not in ("Buffer", "Trig"):
        return
    foreign = {"co": ("REF_", "HSHK_", "ADV_"), "ao": ("REF_",), "do": ("REF_",)}.get(task.kind, ())
    triggers = any(f"_{mark}TRIG" in f"_{name}" for mark in foreign)
    if (kind == "Trig" and triggers) or (kind == "Buffer" and name.startswith("INPUT") is not task.is_input):
        raise DaqmxError(
            DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT,
            f"Specified property is not supported by the channels of {task.name!r}: {name}.",
        )


def _attribute_name(system: NiSystem, call: str, request: Any) -> str:
    enum = request.DESCRIPTOR.fields_by_name["attribute"].enum_type
    number = request.attribute_raw or request.attribute
    if number in _INTERNAL:
        return _INTERNAL[number]
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
    value = _of_task(system, kind, name, request)
    return _default(system, kind, type_, name) if value is None else value


def _of_task(system: NiSystem, kind: str, name: str, request: Any) -> Any:
    """Return a property of a task or channel that its state decides or a program set; None for another."""
    task = system.task(request.task.name)
    if name in _LOOKS:
        system.look()
    if kind == "Chan":
        return _of_channel(system, task, _channels(task, request.channel)[0], name)
    if name in TASK_STATE.get(kind, {}):
        return TASK_STATE[kind][name](system, task)
    value = task.setting(kind, name)
    if value and re.fullmatch(r"(ANLG_(EDGE|WIN|LVL)|DIG_EDGE|DIG_LVL)_\w*_TRIG_SRC", name):
        return system.inventory.written(task.device, value)
    return value


def _of_channel(system: NiSystem, task: Task, channel: Channel, name: str) -> Any:
    if name in CHANNEL_STATE:
        return CHANNEL_STATE[name](channel)
    if channel.kind in ("ci", "co") and name in COUNTER_FACTS:
        return COUNTER_FACTS[name](system, task, channel)
    value = channel.values.get(name)
    if channel.kind == "ci" and name.endswith("_TERM"):
        found = system.inventory.written(channel.device, value) if value else socket_of(channel, name)
        if found is None:
            raise _unserved(system, "Channel", name)
        return found
    return value


def _fact(system: NiSystem, kind: str, name: str, request: Any) -> Any:
    """Return a property that does not depend on a task."""
    if kind == "Device":
        device = system.inventory.device(request.device_name)
        if (
            name.startswith("AI_")
            and not device.ai
            and not name.endswith(("CHANS", "TYPES", "USAGE", "MODES"))
        ):
            raise DaqmxError(
                DAQmxErrors.ATTR_NOT_SUPPORTED,
                f"Specified property is not supported by the device: {name} of {device.product.name}, which "
                "has no analog inputs.",
            )
        if name in DEVICE_FACTS:
            return DEVICE_FACTS[name](system.inventory, device)
    elif kind == "PhysicalChan":
        ((device, tail),) = system.inventory.resolve(request.physical_channel)
        channel = f"{device.name}/{tail}"
        if (known := system.upkeep.get((channel, name))) is not None:
            return known
        if "_TEDS_" in name:
            return sensed(system.teds, channel, name)
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
    return unserved(f"the twin does not know {name} ({kind}).")


def _channels(task: Task, names: str) -> list[Channel]:
    _ = task.kind
    if not names:
        return task.channels
    known = {channel.name.lower(): channel for channel in task.channels}
    wanted = [names] if names.lower() in known else names_in(names)
    try:
        return [known[name.strip().lower()] for name in wanted]
    except KeyError as missing:
        raise DaqmxError(
            DAQmxErrors.CHAN_NOT_IN_TASK,
            f"Specified channel is not in the task: {task.name!r} has no channel {missing.args[0]!r}.",
        ) from None
