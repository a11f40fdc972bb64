"""What the NI system stores: tasks, global channels and scales, of programs and of NI MAX."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import (
    AcquisitionType,
    SampleTimingType,
    TerminalConfiguration,
    UsageTypeAI,
    UsageTypeAO,
    VoltageUnits,
)

from .channel import Channel
from .channels import add
from .devices import Inventory
from .errors import DaqmxError, DAQmxErrors
from .names import names_in
from .reading import Alive, Call
from .scales import scale_named
from .system import NiSystem

_OVERWRITE, _EDITABLE, _DELETABLE = 1, 2, 4
"""Option bits of a request to save something."""


@dataclass(frozen=True)
class SavedTask:
    """Copy of a task at the time when a program saved it."""

    channels: list[Channel]
    settings: dict[tuple[str, str], Any]
    values: dict[str, Any]


@dataclass(frozen=True)
class SavedChannel:
    """Copy of a channel at the time when a program saved it."""

    channel: Channel
    values: dict[str, Any]


def _values(author: str, editable: bool, deletable: bool) -> dict[str, Any]:
    return {"AUTHOR": author, "ALLOW_INTERACTIVE_EDITING": editable, "ALLOW_INTERACTIVE_DELETION": deletable}


def _options(request: Any) -> dict[str, Any]:
    options = int(request.options_raw)
    return _values(request.author, bool(options & _EDITABLE), bool(options & _DELETABLE))


def _replaces(request: Any, kind: str, name: str, known: Mapping[str, Any]) -> None:
    """Raise DaqmxError when something of this name is stored, and must not be replaced."""
    if name in known and not int(request.options_raw) & _OVERWRITE:
        code = {
            "Task": DAQmxErrors.CANT_SAVE_TASK_WITHOUT_REPLACE,
            "Channel": DAQmxErrors.CANT_SAVE_CHAN_WITHOUT_REPLACE,
        }.get(kind, DAQmxErrors.CANT_SAVE_TASK_WITHOUT_REPLACE)
        raise DaqmxError(
            code, f"{kind} cannot be saved: {name!r} is stored already, and the call forbids replacing it."
        )


def _copied(channel: Channel) -> Channel:
    """Copy a channel, so that a property set on one does not change the other."""
    twin = copy.copy(channel)
    twin.values = dict(twin.values)
    return twin


def read_stored(system: NiSystem, kind: str, name: str, request: Any) -> Any:
    """Return property `name` of the request's saved task or channel."""
    if kind == "PersistedTask":
        return request.task_name if name == "ACTIVE_TASK" else _task(system, request.task_name).values[name]
    return request.channel if name == "ACTIVE_CHAN" else _channel(system, request.channel).values[name]


# Tasks


def _task(system: NiSystem, name: str) -> SavedTask:
    found = system.saved_tasks.get(name)
    if not isinstance(found, SavedTask):
        raise DaqmxError(
            DAQmxErrors.TASK_NOT_IN_DATA_NEIGHBORHOOD, f"There is no saved task called {name!r}."
        )
    return found


def _save_task(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    name = request.save_as or task.name
    _replaces(request, "Task", name, system.saved_tasks)
    system.saved_tasks[name] = SavedTask(
        [_copied(channel) for channel in task.channels], dict(task.settings), _options(request)
    )


def _load_task(system: NiSystem, request: Any, alive: Alive) -> Any:
    saved = _task(system, request.session_name)
    task, new = system.create_task(request.session_name, request.initialization_behavior)
    if new:
        task.channels = [_copied(channel) for channel in saved.channels]
        task.settings = dict(saved.settings)
    reply = pb.LoadTaskResponse(new_session_initialized=new)
    reply.task.name = task.session
    return reply


def _delete_task(system: NiSystem, request: Any, alive: Alive) -> None:
    _task(system, request.task_name)
    del system.saved_tasks[request.task_name]


# Channels


def _channel(system: NiSystem, name: str) -> SavedChannel:
    found = system.saved_channels.get(name)
    if not isinstance(found, SavedChannel):
        raise DaqmxError(
            DAQmxErrors.INVALID_GLOBAL_CHAN, f"There is no saved global channel called {name!r}."
        )
    return found


def _save_channel(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    own = next((c for c in task.channels if c.name == request.channel_name), None)
    if own is None:
        raise DaqmxError(
            DAQmxErrors.LAB_VIEW_INVALID_TASK_OR_CHANS,
            f"The task {task.name!r} has no channel {request.channel_name!r}.",
        )
    name = request.save_as or own.name
    _replaces(request, "Channel", name, system.saved_channels)
    system.saved_channels[name] = SavedChannel(replace(_copied(own), name=name), _options(request))


def _delete_channel(system: NiSystem, request: Any, alive: Alive) -> None:
    _channel(system, request.channel_name)
    del system.saved_channels[request.channel_name]


def _add_channels(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    channels = []
    for name in names_in(request.channel_names):
        channel = _copied(_channel(system, name).channel)
        channel.values["CHAN_IS_GLOBAL"] = True
        channels.append(channel)
    add(task, channels)


# Scales


def _save_scale(system: NiSystem, request: Any, alive: Alive) -> None:
    scale = scale_named(system.scales, request.scale_name).copy()
    scale.values |= _options(request)
    system.scales[request.save_as or request.scale_name] = scale


def _delete_scale(system: NiSystem, request: Any, alive: Alive) -> None:
    scale_named(system.scales, request.scale_name)
    del system.scales[request.scale_name]


# What NI MAX exports

_TERMINALS = {
    "RSE": TerminalConfiguration.RSE,
    "NRSE": TerminalConfiguration.NRSE,
    "Differential": TerminalConfiguration.DIFF,
    "Pseudodifferential": TerminalConfiguration.PSEUDO_DIFF,
}
_MODES = {"Finite Samples": AcquisitionType.FINITE, "Continuous Samples": AcquisitionType.CONTINUOUS}


def saved_in_export(
    export: Mapping[str, Mapping[str, str]], inventory: Inventory
) -> tuple[dict[str, object], dict[str, object]]:
    """Return the saved tasks and global channels of an export: of voltage, on devices that are simulated."""
    channels: dict[str, tuple[Channel, dict[str, Any]]] = {}
    tasks: dict[str, object] = {}
    for section, entry in export.items():
        kind, _, name = section.partition(" ")
        values = _values(
            entry.get("Author", "").strip('"'),
            entry.get("AllowInteractiveEditing", "False") == "True",
            entry.get("AllowInteractiveDeletion", "False") == "True",
        )
        if kind == "DAQmxChannel":
            channel = _exported(name, entry, inventory)
            if channel is not None:
                channels[name] = (channel, values)
        elif kind == "DAQmxTask":
            tasks[name] = (entry, values)
    made: dict[str, object] = {}
    for name, (entry, values) in list(tasks.items()):  # type: ignore[misc]
        own = [text.strip() for text in entry.get("Channels", "").split(",") if text.strip()]
        if all(channel in channels for channel in own):
            members = [replace(_copied(channels[c][0]), name=c.rpartition("/")[2]) for c in own]
            made[name] = SavedTask(members, _timing(entry), values)
    return made, {
        name: SavedChannel(channel, values) for name, (channel, values) in channels.items() if "/" not in name
    }


def _exported(name: str, entry: Mapping[str, str], inventory: Inventory) -> Channel | None:
    device, _, tail = entry.get("PhysicalChanName", "").partition("/")
    way = {"Analog Input": "AI", "Analog Output": "AO"}.get(entry.get("ChanType", ""))
    measured = entry.get("AI.MeasType") or entry.get("AO.OutputType")
    if device not in inventory.devices or way is None or measured != "Voltage":
        return None
    values: dict[str, Any] = {
        f"{way}_MIN": float(entry.get(f"{way}.Min", -10)),
        f"{way}_MAX": float(entry.get(f"{way}.Max", 10)),
        f"{way}_VOLTAGE_UNITS": VoltageUnits.VOLTS.value,
        f"{way}_CUSTOM_SCALE_NAME": "",
        f"{way}_TERM_CFG": _TERMINALS.get(entry.get(f"{way}.TermCfg", ""), TerminalConfiguration.DIFF).value,
        "CHAN_DESCR": entry.get("Descr", "").strip('"'),
    }
    usage = (
        {"AI_MEAS_TYPE": UsageTypeAI.VOLTAGE.value, "AI_MEAS_TYPE_NAME": "VOLTAGE"}
        if way == "AI"
        else {"AO_OUTPUT_TYPE": UsageTypeAO.VOLTAGE.value}
    )
    return Channel(
        name, "ai" if way == "AI" else "ao", inventory.devices[device], (tail.lower(),), values | usage
    )


def _timing(entry: Mapping[str, str]) -> dict[tuple[str, str], Any]:
    if entry.get("SampTimingType") != "Sample Clock":
        return {}
    return {
        ("Timing", "SAMP_TIMING_TYPE"): SampleTimingType.SAMPLE_CLOCK.value,
        ("Timing", "SAMP_CLK_RATE"): float(entry.get("SampClk.Rate", 1000)),
        ("Timing", "SAMP_QUANT_SAMP_PER_CHAN"): int(entry.get("SampQuant.SampPerChan", 1000)),
        ("Timing", "SAMP_QUANT_SAMP_MODE"): _MODES.get(
            entry.get("SampQuant.SampMode", ""), AcquisitionType.FINITE
        ).value,
    }


STORAGE: dict[str, Call] = {
    "SaveTask": _save_task,
    "LoadTask": _load_task,
    "DeleteSavedTask": _delete_task,
    "SaveGlobalChan": _save_channel,
    "DeleteSavedGlobalChan": _delete_channel,
    "AddGlobalChansToTask": _add_channels,
    "SaveScale": _save_scale,
    "DeleteSavedScale": _delete_scale,
}
"""Calls of this module, by name."""
