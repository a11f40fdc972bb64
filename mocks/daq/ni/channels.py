"""Create calls of virtual channels, and the grouping of lines into digital channels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nidaqmx.constants import (
    CurrentShuntResistorLocation,
    LineGrouping,
    TerminalConfiguration,
    UsageTypeAI,
    UsageTypeAO,
    UsageTypeCI,
    UsageTypeCO,
)

from .devices import NiDevice
from .errors import DaqmxError, DAQmxErrors
from .scales import Scale
from .system import NiSystem
from .tasks import Channel, Kind, Task

__all__ = ["CREATES", "field"]


def field(request: Any, name: str) -> Any:
    """Return a field of a request, given as the enum or as its raw number."""
    raw = f"{name}_raw"
    fields = request.DESCRIPTOR.fields_by_name
    if raw in fields and getattr(request, raw):
        return getattr(request, raw)
    return getattr(request, name) if name in fields else None


def _add(task: Task, channels: list[Channel]) -> None:
    if task.running:
        raise DaqmxError(
            DAQmxErrors.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING,
            "Specified operation cannot be performed while the task is running: channels cannot be added.",
        )
    names = {channel.name for channel in task.channels}
    for channel in channels:
        if channel.name in names:
            raise DaqmxError(
                DAQmxErrors.CHAN_ALREADY_IN_TASK,
                f"Channel specified already exists in the task: {channel.name!r}.",
            )
        homes = {c.device.chassis or c.device.name for c in (*task.channels, channel)}
        if len(homes) > 1:
            raise DaqmxError(
                DAQmxErrors.MULTI_DEVS_IN_TASK,
                f"Specified operation cannot be performed when there are multiple devices in the task: "
                f"{', '.join(sorted(homes))}.",
            )
        if task.channels and task.kind != channel.kind:
            raise DaqmxError(
                DAQmxErrors.LAB_VIEW_INVALID_TASK_OR_CHANS,
                f"A task holds channels of one kind: {task.name!r} already has {task.kind} channels.",
            )
        task.channels.append(channel)
        names.add(channel.name)


def _named(assigned: str, resolved: list[tuple[NiDevice, str]]) -> list[str]:
    if not assigned:
        return [f"{device.name}/{tail}" for device, tail in resolved]
    if len(resolved) == 1:
        return [assigned]
    return [f"{assigned}{i}" for i in range(len(resolved))]


def _limits(request: Any, kind: str, values: dict[str, Any]) -> None:
    low, high = request.min_val, request.max_val
    if not low < high:
        raise DaqmxError(
            DAQmxErrors.MIN_NOT_LESS_THAN_MAX,
            f"Minimum is greater than or equal to the maximum: {low:g}, {high:g}.",
        )
    values[f"{kind}_MIN"], values[f"{kind}_MAX"] = low, high


def _scale(system: NiSystem, name: str) -> Scale | None:
    if not name:
        return None
    if name not in system.scales:
        raise DaqmxError(
            DAQmxErrors.CUSTOM_SCALE_DOES_NOT_EXIST,
            f"Custom scale specified does not exist: {name!r}.",
        )
    return system.scales[name]


def _terminal_config(device: NiDevice, tail: str, asked: int) -> int:
    if tail.startswith("_"):
        return int(TerminalConfiguration.DIFF.value)
    number = int(tail.removeprefix("ai"))
    differential = device.ai_takes_differential(number)
    if asked in (0, -1, TerminalConfiguration.DEFAULT.value):
        return int((TerminalConfiguration.DIFF if differential else TerminalConfiguration.RSE).value)
    single = asked in (TerminalConfiguration.RSE.value, TerminalConfiguration.NRSE.value)
    if (single and device.ai_is_differential_only()) or (
        asked == TerminalConfiguration.DIFF.value and not differential
    ):
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            "Requested value is not a supported value for this property: terminal configuration "
            f"{TerminalConfiguration(asked).name} on {device.name}/{tail} of {device.product.name}.",
        )
    return asked


def _analog_input(
    measurement: UsageTypeAI, units: str, properties: dict[str, str]
) -> Callable[[NiSystem, Any], None]:
    """Make a create call of analog input; `properties` maps fields of its request to attributes."""

    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        resolved = list(system.inventory.resolve(request.physical_channel))
        made = []
        for name, (device, tail) in zip(
            _named(request.name_to_assign_to_channel, resolved), resolved, strict=True
        ):
            if not tail.startswith(("ai", "_ao", "_board")):
                raise _wrong_kind(device, tail, "analog input")
            values: dict[str, Any] = {
                "AI_MEAS_TYPE": measurement.value,
                "AI_MEAS_TYPE_NAME": measurement.name,
                units: field(request, "units"),
                "AI_CUSTOM_SCALE_NAME": getattr(request, "custom_scale_name", ""),
                "AI_TERM_CFG": _terminal_config(device, tail, field(request, "terminal_config") or 0),
            }
            if "min_val" in request.DESCRIPTOR.fields_by_name:
                _limits(request, "AI", values)
            values |= {attribute: field(request, name) for name, attribute in properties.items()}
            if values.get("AI_CURRENT_SHUNT_LOC") == CurrentShuntResistorLocation.LET_DRIVER_CHOOSE.value:
                values["AI_CURRENT_SHUNT_LOC"] = CurrentShuntResistorLocation.EXTERNAL.value
            scale = _scale(system, values["AI_CUSTOM_SCALE_NAME"])
            made.append(Channel(name, "ai", device, (tail,), values, scale=scale))
        _add(task, made)

    return create


def _analog_output(system: NiSystem, request: Any) -> None:
    task = system.task(request.task.name)
    resolved = list(system.inventory.resolve(request.physical_channel))
    made = []
    for name, (device, tail) in zip(
        _named(request.name_to_assign_to_channel, resolved), resolved, strict=True
    ):
        if not tail.startswith("ao"):
            raise _wrong_kind(device, tail, "analog output")
        values: dict[str, Any] = {
            "AO_OUTPUT_TYPE": UsageTypeAO.VOLTAGE.value,
            "AO_VOLTAGE_UNITS": field(request, "units"),
            "AO_CUSTOM_SCALE_NAME": request.custom_scale_name,
        }
        _limits(request, "AO", values)
        scale = _scale(system, request.custom_scale_name)
        made.append(Channel(name, "ao", device, (tail,), values, scale=scale))
    _add(task, made)


def _lines_of(device: NiDevice, tail: str) -> list[str]:
    """Return the line itself, or all lines of a port in rising order."""
    port = tail.removeprefix("port")
    if not port.isdecimal():
        return [tail]
    return [f"{tail}/line{i}" for i in range(device.product.ports[int(port)])]


def _digital(kind: Kind) -> Callable[[NiSystem, Any], None]:
    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        together = field(request, "line_grouping") == LineGrouping.CHAN_FOR_ALL_LINES.value
        resolved = list(system.inventory.resolve(request.lines))
        if not together:
            # NI's reference of DAQmxCreateDIChan: a port's name alone means all its lines.
            resolved = [(device, line) for device, tail in resolved for line in _lines_of(device, tail)]
        groups: list[tuple[NiDevice, tuple[str, ...], bool]] = []
        for device, tail in resolved:
            if not tail.startswith("port"):
                raise _wrong_kind(device, tail, "digital")
            # A whole port is listed from its highest line down.
            lines = tuple(reversed(_lines_of(device, tail)))
            groups.append((device, lines, "/line" not in tail))
        if together and groups:
            device = groups[0][0]
            every = tuple(line for _, lines, _ in groups for line in lines)
            groups = [(device, every, all(whole for _, _, whole in groups))]
        names = _digital_names(request.name_to_assign_to_lines, groups, resolved)
        _add(
            task,
            [
                Channel(name, kind, device, lines, ports=whole)
                for name, (device, lines, whole) in zip(names, groups, strict=True)
            ],
        )

    return create


def _digital_names(
    assigned: str,
    groups: list[tuple[NiDevice, tuple[str, ...], bool]],
    resolved: list[tuple[NiDevice, str]],
) -> list[str]:
    if assigned:
        return [assigned] if len(groups) == 1 else [f"{assigned}{i}" for i in range(len(groups))]
    if len(groups) == len(resolved):
        return [f"{device.name}/{tail}" for device, tail in resolved]
    # The driver's name of a channel with several lines.
    return [f"{resolved[0][0].name}/{resolved[0][1]}..."]


def _pulse_output(
    output: UsageTypeCO, rate: Callable[[Any], float], properties: dict[str, str]
) -> Callable[[NiSystem, Any], None]:
    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        resolved = list(system.inventory.resolve(request.counter))
        made = []
        for name, (device, tail) in zip(
            _named(request.name_to_assign_to_channel, resolved), resolved, strict=True
        ):
            if "ctr" not in tail:
                raise _wrong_kind(device, tail, "counter output")
            values: dict[str, Any] = {"CO_OUTPUT_TYPE": output.value}
            values |= {attribute: field(request, name) for name, attribute in properties.items()}
            made.append(Channel(name, "co", device, (tail,), values))
        _add(task, made)
        task.settings["Timing", "SAMP_CLK_RATE"] = rate(request)

    return create


def _counter_input(measurement: UsageTypeCI, properties: dict[str, str]) -> Callable[[NiSystem, Any], None]:
    """Make a create call of a counter input that can be configured, started and waited for, but not read."""

    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        resolved = list(system.inventory.resolve(request.counter))
        made = []
        for name, (device, tail) in zip(
            _named(request.name_to_assign_to_channel, resolved), resolved, strict=True
        ):
            if "ctr" not in tail:
                raise _wrong_kind(device, tail, "counter input")
            values: dict[str, Any] = {"CI_MEAS_TYPE": measurement.value}
            values |= {attribute: field(request, name) for name, attribute in properties.items()}
            made.append(Channel(name, "ci", device, (tail,), values))
        _add(task, made)

    return create


def _wrong_kind(device: NiDevice, tail: str, kind: str) -> DaqmxError:
    return DaqmxError(
        DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST,
        f"Physical channel specified does not exist on this device: {device.name}/{tail} is not a channel "
        f"for {kind} of {device.product.name}.",
    )


_EXCITATION = {"current_excit_source": "AI_EXCIT_SRC", "current_excit_val": "AI_EXCIT_VAL"}
_THERMISTOR = {
    "resistance_config": "AI_RESISTANCE_CFG",
    "a": "AI_THRMSTR_A",
    "b": "AI_THRMSTR_B",
    "c": "AI_THRMSTR_C",
}

CREATES: dict[str, Callable[[NiSystem, Any], None]] = {
    "CreateAIVoltageChan": _analog_input(UsageTypeAI.VOLTAGE, "AI_VOLTAGE_UNITS", {}),
    "CreateAIVoltageChanWithExcit": _analog_input(
        UsageTypeAI.VOLTAGE_CUSTOM_WITH_EXCITATION,
        "AI_VOLTAGE_UNITS",
        {
            "bridge_config": "AI_BRIDGE_CFG",
            "voltage_excit_source": "AI_EXCIT_SRC",
            "voltage_excit_val": "AI_EXCIT_VAL",
            "use_excit_for_scaling": "AI_EXCIT_USE_FOR_SCALING",
        },
    ),
    "CreateAICurrentChan": _analog_input(
        UsageTypeAI.CURRENT,
        "AI_CURRENT_UNITS",
        {
            "shunt_resistor_loc": "AI_CURRENT_SHUNT_LOC",
            "ext_shunt_resistor_val": "AI_CURRENT_SHUNT_RESISTANCE",
        },
    ),
    "CreateAIThrmcplChan": _analog_input(
        UsageTypeAI.TEMPERATURE_THERMOCOUPLE,
        "AI_TEMP_UNITS",
        {
            "thermocouple_type": "AI_THRMCPL_TYPE",
            "cjc_source": "AI_THRMCPL_CJC_SRC",
            "cjc_val": "AI_THRMCPL_CJC_VAL",
            "cjc_channel": "AI_THRMCPL_CJC_CHAN",
        },
    ),
    "CreateAIRTDChan": _analog_input(
        UsageTypeAI.TEMPERATURE_RTD,
        "AI_TEMP_UNITS",
        {
            "rtd_type": "AI_RTD_TYPE",
            "resistance_config": "AI_RESISTANCE_CFG",
            "r0": "AI_RTD_R0",
            **_EXCITATION,
        },
    ),
    "CreateAIResistanceChan": _analog_input(
        UsageTypeAI.RESISTANCE,
        "AI_RESISTANCE_UNITS",
        {"resistance_config": "AI_RESISTANCE_CFG", **_EXCITATION},
    ),
    "CreateAIThrmstrChanIex": _analog_input(
        UsageTypeAI.TEMPERATURE_THERMISTOR, "AI_TEMP_UNITS", {**_THERMISTOR, **_EXCITATION}
    ),
    "CreateAIThrmstrChanVex": _analog_input(
        UsageTypeAI.TEMPERATURE_THERMISTOR,
        "AI_TEMP_UNITS",
        {
            **_THERMISTOR,
            "voltage_excit_source": "AI_EXCIT_SRC",
            "voltage_excit_val": "AI_EXCIT_VAL",
            "r1": "AI_THRMSTR_R1",
        },
    ),
    "CreateAIStrainGageChan": _analog_input(
        UsageTypeAI.STRAIN_STRAIN_GAGE,
        "AI_STRAIN_UNITS",
        {
            "strain_config": "AI_STRAIN_GAGE_CFG",
            "voltage_excit_source": "AI_EXCIT_SRC",
            "voltage_excit_val": "AI_EXCIT_VAL",
            "gage_factor": "AI_STRAIN_GAGE_GAGE_FACTOR",
            "initial_bridge_voltage": "AI_BRIDGE_INITIAL_VOLTAGE",
            "nominal_gage_resistance": "AI_BRIDGE_NOM_RESISTANCE",
            "poisson_ratio": "AI_STRAIN_GAGE_POISSON_RATIO",
            "lead_wire_resistance": "AI_LEAD_WIRE_RESISTANCE",
        },
    ),
    "CreateAITempBuiltInSensorChan": _analog_input(
        UsageTypeAI.TEMPERATURE_BUILT_IN_SENSOR, "AI_TEMP_UNITS", {}
    ),
    "CreateAOVoltageChan": _analog_output,
    "CreateDIChan": _digital("di"),
    "CreateDOChan": _digital("do"),
    "CreateCICountEdgesChan": _counter_input(
        UsageTypeCI.COUNT_EDGES,
        {
            "edge": "CI_COUNT_EDGES_ACTIVE_EDGE",
            "initial_count": "CI_COUNT_EDGES_INITIAL_CNT",
            "count_direction": "CI_COUNT_EDGES_DIR",
        },
    ),
    "CreateCIPulseWidthChan": _counter_input(
        UsageTypeCI.PULSE_WIDTH_DIGITAL,
        {
            "min_val": "CI_MIN",
            "max_val": "CI_MAX",
            "units": "CI_PULSE_WIDTH_UNITS",
            "starting_edge": "CI_PULSE_WIDTH_STARTING_EDGE",
        },
    ),
    "CreateCOPulseChanFreq": _pulse_output(
        UsageTypeCO.PULSE_FREQUENCY,
        lambda r: float(r.freq),
        {
            "freq": "CO_PULSE_FREQ",
            "duty_cycle": "CO_PULSE_DUTY_CYC",
            "idle_state": "CO_PULSE_IDLE_STATE",
            "initial_delay": "CO_PULSE_FREQ_INITIAL_DELAY",
            "units": "CO_PULSE_FREQ_UNITS",
        },
    ),
    "CreateCOPulseChanTime": _pulse_output(
        UsageTypeCO.PULSE_TIME,
        lambda r: 1 / (r.low_time + r.high_time),
        {
            "low_time": "CO_PULSE_LOW_TIME",
            "high_time": "CO_PULSE_HIGH_TIME",
            "idle_state": "CO_PULSE_IDLE_STATE",
            "initial_delay": "CO_PULSE_TIME_INITIAL_DELAY",
            "units": "CO_PULSE_TIME_UNITS",
        },
    ),
}
"""Create calls that are served, by name."""
