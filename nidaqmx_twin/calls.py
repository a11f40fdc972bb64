"""Calls that configure and run a task, and calls about devices, their sensors and the system."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, timedelta
from pathlib import Path
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import SampleTimingType, Signal, TaskMode, TimestampEvent, TriggerType
from nidaqmx.utils import flatten_channel_string

from .channels import CREATES
from .counter_calls import COUNTING
from .errors import DaqmxError, DAQmxErrors, error_string
from .maintenance import KEEPING, UPKEEP
from .names import field, names_in
from .reading import Alive, Call
from .storage import STORAGE
from .system import NiSystem
from .tasks import Task, refuse_rate
from .tdms import log
from .teds import BASIC, not_detected, teds_from_file
from .transfers import POWER, TRANSFERS
from .waveform_calls import WAVEFORMS


def _configure_teds(system: NiSystem, request: Any, alive: Alive) -> None:
    for device, tail in system.inventory.resolve(request.physical_channel):
        if not request.file_path:
            raise not_detected(f"{device.name}/{tail}")
        system.teds[f"{device.name}/{tail}"] = teds_from_file(Path(request.file_path))


def _clear_teds(system: NiSystem, request: Any, alive: Alive) -> None:
    for device, tail in system.inventory.resolve(request.physical_channel):
        system.teds.pop(f"{device.name}/{tail}", None)


def _write_teds(of: str) -> Call:
    """Make a call that writes into a sensor's memory: there is none here that can be written to."""

    def call(system: NiSystem, request: Any, alive: Alive) -> None:
        ((device, tail), *_) = system.inventory.resolve(request.physical_channel)
        given = getattr(request, of)
        if of == "file_path" and given:
            teds_from_file(Path(given))
        elif len(given) * 8 < BASIC:
            raise DaqmxError(
                DAQmxErrors.TEDS_SENSOR_DATA_ERROR, "TEDS sensor data are not valid: too few bits."
            )
        raise not_detected(f"{device.name}/{tail}")

    return call


def _properties(kind: str, fixed: dict[str, Any], fields: dict[str, str]) -> Call:
    """Make a configuration call that only sets properties: constants, and fields of its request by name."""

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        task = system.task(request.task.name)
        _ = task.kind  # -200478 without channels
        _refuse_running(task)
        system.changed_properties(task)
        for attribute, value in fixed.items():
            task.settings[kind, attribute] = value
        for name, attribute in fields.items():
            value = field(request, name)
            refuse_rate(attribute, value)
            if attribute == "START_TRIG_TRIG_WHEN":
                value = value.ToDatetime(tzinfo=UTC)
            target = "Trig" if "TRIG" in attribute else "ExportedSignal" if "EVENT" in attribute else kind
            if attribute.startswith("SAMP_CLK_PULSE"):
                target = "ExportedSignal"
            is_list = hasattr(value, "__len__") and not isinstance(value, str)
            task.settings[target, attribute] = list(value) if is_list else value
        task.settings.pop(("Timing", "SAMP_CLK_TIMEBASE_DIV"), None)
        if task.setting("Timing", "SAMP_CLK_SRC") in ("", "OnboardClock"):
            del task.settings["Timing", "SAMP_CLK_SRC"]

    return call


_QUANTITY = {"sample_mode": "SAMP_QUANT_SAMP_MODE", "samps_per_chan": "SAMP_QUANT_SAMP_PER_CHAN"}
_BURST = {"sample_clk_rate": "SAMP_CLK_RATE", "pause_when": "DIG_LVL_PAUSE_TRIG_WHEN",
          "ready_event_active_level": "RDY_FOR_XFER_EVENT_LVL_ACTIVE_LVL", **_QUANTITY}  # fmt: skip


def _timing(type_: SampleTimingType, fields: dict[str, str]) -> Call:
    return _properties("Timing", {"SAMP_TIMING_TYPE": type_.value}, {**fields, **_QUANTITY})


def _trigger(which: str, type_: TriggerType, prefix: str, fields: dict[str, str]) -> Call:
    named = {name: f"{prefix}_{which}_TRIG_{tail}" for name, tail in fields.items()}
    if which == "REF":
        named["pretrigger_samples"] = "REF_TRIG_PRETRIG_SAMPLES"
    return _properties("Trig", {f"{which}_TRIG_TYPE": type_.value}, named)


_CLOCK = {"rate": "SAMP_CLK_RATE", "source": "SAMP_CLK_SRC", "active_edge": "SAMP_CLK_ACTIVE_EDGE"}
_EDGE = {"trigger_source": "SRC", "trigger_edge": "EDGE"}
_SLOPE = {"trigger_source": "SRC", "trigger_slope": "SLOPE", "trigger_level": "LVL"}
_WINDOW = {"trigger_source": "SRC", "window_top": "TOP", "window_bottom": "BTM", "trigger_when": "WHEN"}
_PATTERN = {"trigger_source": "SRC", "trigger_pattern": "PATTERN", "trigger_when": "WHEN"}
_SLOPES = {"trigger_sources": "SRCS", "trigger_slope_array": "SLOPES", "trigger_level_array": "LVLS"}

_CONFIGURES: dict[str, Call] = {
    "CfgSampClkTiming": _timing(SampleTimingType.SAMPLE_CLOCK, _CLOCK),
    "CfgPipelinedSampClkTiming": _timing(SampleTimingType.PIPELINED_SAMPLE_CLOCK, _CLOCK),
    "CfgImplicitTiming": _timing(SampleTimingType.IMPLICIT, {}),
    "CfgHandshakingTiming": _timing(SampleTimingType.HANDSHAKE, {}),
    "CfgBurstHandshakingTimingImportClock": _timing(
        SampleTimingType.BURST_HANDSHAKE,
        {**_BURST, "sample_clk_src": "SAMP_CLK_SRC", "sample_clk_active_edge": "SAMP_CLK_ACTIVE_EDGE"},
    ),
    "CfgBurstHandshakingTimingExportClock": _timing(
        SampleTimingType.BURST_HANDSHAKE, {**_BURST, "sample_clk_pulse_polarity": "SAMP_CLK_PULSE_POLARITY"}
    ),
    "CfgDigEdgeStartTrig": _trigger("START", TriggerType.DIGITAL_EDGE, "DIG_EDGE", _EDGE),
    "CfgDigEdgeRefTrig": _trigger("REF", TriggerType.DIGITAL_EDGE, "DIG_EDGE", _EDGE),
    "CfgAnlgEdgeStartTrig": _trigger("START", TriggerType.ANALOG_EDGE, "ANLG_EDGE", _SLOPE),
    "CfgAnlgEdgeRefTrig": _trigger("REF", TriggerType.ANALOG_EDGE, "ANLG_EDGE", _SLOPE),
    "CfgAnlgWindowStartTrig": _trigger("START", TriggerType.ANALOG_WINDOW, "ANLG_WIN", _WINDOW),
    "CfgAnlgWindowRefTrig": _trigger("REF", TriggerType.ANALOG_WINDOW, "ANLG_WIN", _WINDOW),
    "CfgDigPatternStartTrig": _trigger("START", TriggerType.DIGITAL_PATTERN, "DIG_PATTERN", _PATTERN),
    "CfgDigPatternRefTrig": _trigger("REF", TriggerType.DIGITAL_PATTERN, "DIG_PATTERN", _PATTERN),
    "CfgAnlgMultiEdgeStartTrig": _trigger("START", TriggerType.ANALOG_MULTI_EDGE, "ANLG_MULTI_EDGE", _SLOPES),
    "CfgAnlgMultiEdgeRefTrig": _trigger("REF", TriggerType.ANALOG_MULTI_EDGE, "ANLG_MULTI_EDGE", _SLOPES),
    "CfgTimeStartTrig": _properties(
        "Trig",
        {"START_TRIG_TYPE": TriggerType.TIME.value},
        {"when": "START_TRIG_TRIG_WHEN", "timescale": "START_TRIG_TIMESCALE"},
    ),
    "DisableStartTrig": _properties("Trig", {"START_TRIG_TYPE": TriggerType.NONE.value}, {}),
    "DisableRefTrig": _properties("Trig", {"REF_TRIG_TYPE": TriggerType.NONE.value}, {}),
    "CfgInputBuffer": _properties("Buffer", {}, {"num_samps_per_chan": "INPUT_BUF_SIZE"}),
    "CfgOutputBuffer": _properties("Buffer", {}, {"num_samps_per_chan": "OUTPUT_BUF_SIZE"}),
}


def _change_detection(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    _ = task.kind
    _refuse_running(task)
    task.settings["Timing", "SAMP_TIMING_TYPE"] = SampleTimingType.CHANGE_DETECTION.value
    for name, attribute in _QUANTITY.items():
        task.settings["Timing", attribute] = field(request, name)
    for edge in ("rising", "falling"):
        lines = getattr(request, f"{edge}_edge_chan")
        task.settings["Timing", f"CHANGE_DETECT_DI_{edge.upper()}_EDGE_PHYSICAL_CHANS"] = ", ".join(
            names_in(lines)
        )


def _export_signal(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    prefix = {
        Signal.SAMPLE_CLOCK.value: "SAMP_CLK",
        Signal.START_TRIGGER.value: "START_TRIG",
        Signal.REFERENCE_TRIGGER.value: "REF_TRIG",
        Signal.AI_CONVERT_CLOCK.value: "AI_CONV_CLK",
        Signal.COUNTER_OUTPUT_EVENT.value: "CTR_OUT_EVENT",
        Signal.CHANGE_DETECTION_EVENT.value: "CHANGE_DETECT_EVENT",
        Signal.TEN_MHZ_REF_CLOCK.value: "10_MHZ_REF_CLK",
        Signal.TWENTY_MHZ_TIMEBASE_CLOCK.value: "20_MHZ_TIMEBASE",
        Signal.ADVANCE_TRIGGER.value: "ADV_TRIG",
    }.get(field(request, "signal_id"))
    if prefix is None:
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE, f"Signal {field(request, 'signal_id')} cannot be exported."
        )
    task.settings["ExportedSignal", f"{prefix}_OUTPUT_TERM"] = request.output_terminal


def _logging(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    for name, attribute in (
        ("file_path", "LOGGING_FILE_PATH"),
        ("logging_mode", "LOGGING_MODE"),
        ("group_name", "LOGGING_TDMS_GROUP_NAME"),
        ("operation", "LOGGING_TDMS_OPERATION"),
    ):
        task.settings["Read", attribute] = field(request, name)


def _new_file(system: NiSystem, request: Any, alive: Alive) -> None:
    system.task(request.task.name).settings["Read", "LOGGING_FILE_PATH"] = request.file_path


def _refuse_running(task: Task) -> None:
    if task.running:
        raise DaqmxError(
            DAQmxErrors.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING,
            f"Specified operation cannot be performed while the task is running: {task.name!r}.",
        )


# Running


def _start(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    system.start(task)
    return pb.StartTaskResponse(status=task.warning)


def _create_task(system: NiSystem, request: Any, alive: Alive) -> Any:
    task, new = system.create_task(request.session_name, request.initialization_behavior)
    reply = pb.CreateTaskResponse(new_session_initialized=new)
    reply.task.name = task.session
    return reply


def _control(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    action = TaskMode(field(request, "action"))
    if action is TaskMode.TASK_START:
        system.start(task)
    elif action is TaskMode.TASK_STOP:
        system.stop(task)
    elif action is TaskMode.TASK_VERIFY:
        system.verify(task)
    elif action is TaskMode.TASK_COMMIT:
        system.commit(task)
    elif action is TaskMode.TASK_RESERVE:
        system.reserve(task)
    else:
        system.release(task)


def _stop(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)
    failure = task.failure
    try:
        log(system, task)
    finally:
        system.stop(task)
        task.failure = None
    if failure is not None:
        raise DaqmxError(DAQmxErrors(failure.code), str(failure.args[0]))


def _is_done(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    system.look()
    system.cut_off(task)
    log(system, task)
    if task.failure is not None:
        raise task.failure
    return pb.IsTaskDoneResponse(is_task_done=task.done(system.clock.now()))


def _wait_until_done(system: NiSystem, request: Any, alive: Alive) -> None:
    task = system.task(request.task.name)

    def due() -> float | None:
        if task.kind != "co" and task.total is None:
            return None
        return system.glimpse(task) or task.ready((task.total or 1) + task.late)

    if not system.wait(lambda: task.done(system.clock.now()), due, request.time_to_wait, alive):
        raise DaqmxError(
            DAQmxErrors.WAIT_UNTIL_DONE_DOES_NOT_INDICATE_DONE,
            f"Wait until done did not indicate that the task was done within {request.time_to_wait:g} s.",
        )
    log(system, task)


def _wait_for_timestamp(system: NiSystem, request: Any, alive: Alive) -> Any:
    task = system.task(request.task.name)
    event = TimestampEvent(field(request, "timestamp_event"))
    enabled = {
        TimestampEvent.START_TRIGGER: "START_TRIG_TIMESTAMP_ENABLE",
        TimestampEvent.REFERENCE_TRIGGER: "REF_TRIG_TIMESTAMP_ENABLE",
        TimestampEvent.ARM_START_TRIGGER: "ARM_START_TRIG_TIMESTAMP_ENABLE",
    }.get(event)
    if enabled and not task.setting("Trig", enabled, False):
        raise DaqmxError(DAQmxErrors.TIMESTAMP_NOT_ENABLED, f"The timestamp of {event.name} is not enabled.")
    if not system.wait(lambda: task.clock.start is not None, lambda: None, request.timeout, alive):
        raise DaqmxError(DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE, f"{task.name!r} has not started yet.")
    reply = pb.WaitForValidTimestampResponse()
    reply.timestamp.FromDatetime(system.epoch + timedelta(seconds=task.clock.start or 0.0))
    return reply


# Devices and the system


def _nth_channel(system: NiSystem, request: Any, alive: Alive) -> Any:
    return pb.GetNthTaskChannelResponse(
        buffer=system.task(request.task.name).channels[request.index - 1].name
    )


def _nth_device(system: NiSystem, request: Any, alive: Alive) -> Any:
    return pb.GetNthTaskDeviceResponse(buffer=system.task(request.task.name).devices[request.index - 1].name)


def _creating(create: Callable[[NiSystem, Any], None]) -> Call:
    def call(system: NiSystem, request: Any, alive: Alive) -> None:
        task = system.task(request.task.name)
        before = len(task.channels)
        create(system, request)
        system.created = _listed([channel.name for channel in task.channels[before:]])
        if not task.running:
            system.release(task)

    return call


def _listed(names: list[str]) -> str:
    """Names in NI's short form, "a0:3", where it gives these names again."""
    short = str(flatten_channel_string(names))
    return short if names_in(short) == names else ", ".join(names)


def _known_device(system: NiSystem, request: Any, alive: Alive) -> None:
    system.inventory.device(request.device_name)


CALLS: dict[str, Call] = {
    **_CONFIGURES,
    **{name: _creating(create) for name, create in CREATES.items()},
    **TRANSFERS,
    **COUNTING,
    **KEEPING,
    **POWER,
    **STORAGE,
    "ConfigureTEDS": _configure_teds,
    "ClearTEDS": _clear_teds,
    "WriteToTEDSFromArray": _write_teds("bit_stream"),
    "WriteToTEDSFromFile": _write_teds("file_path"),
    **UPKEEP,
    **WAVEFORMS,
    "CfgChangeDetectionTiming": _change_detection,
    "ExportSignal": _export_signal,
    "ConfigureLogging": _logging,
    "StartNewFile": _new_file,
    "CreateTask": _create_task,
    "ClearTask": lambda s, r, a: s.clear_task(s.task(r.task.name)),
    "StartTask": _start,
    "StopTask": _stop,
    "TaskControl": _control,
    "IsTaskDone": _is_done,
    "WaitUntilTaskDone": _wait_until_done,
    "WaitForValidTimestamp": _wait_for_timestamp,
    "GetNthTaskChannel": _nth_channel,
    "GetNthTaskReadChannel": lambda s, r, a: pb.GetNthTaskReadChannelResponse(
        buffer=_nth_channel(s, r, a).buffer
    ),
    "GetNthTaskDevice": _nth_device,
    "GetErrorString": lambda s, r, a: pb.GetErrorStringResponse(error_string=error_string(r.error_code)),
    "ResetDevice": lambda s, r, a: s.reset_device(s.inventory.device(r.device_name)),
    "SelfTestDevice": _known_device,
    "DeviceSupportsCal": lambda s, r, a: pb.DeviceSupportsCalResponse(
        cal_supported=bool(s.inventory.device(r.device_name).ai or s.inventory.device(r.device_name).ao)
    ),
    "TristateOutputTerm": lambda s, r, a: None,
}
"""Calls with a single answer that are not about a property, by name. A result of None means success."""
