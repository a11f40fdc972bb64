"""Create calls of virtual channels, and the grouping of lines into digital channels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import (
    Coupling,
    CurrentShuntResistorLocation,
    ExcitationSource,
    LineGrouping,
    StrainGageRosetteMeasurementType,
    TerminalConfiguration,
    UsageTypeAI,
    UsageTypeAO,
    UsageTypeCI,
)

from .channel import Channel, Kind
from .counters import COUNTERS
from .devices import CONFIGURATIONS, NiDevice
from .errors import DaqmxError, DAQmxErrors, unsupported
from .measurements import FIELDS, MEASUREMENTS, Measurement, measures
from .names import channel_names, field
from .scales import Scale, scale_named
from .system import NiSystem
from .tasks import Task
from .teds import teds_values


def add(task: Task, channels: list[Channel]) -> None:
    """Give a task channels. Raises DaqmxError for those that it cannot have together."""
    if task.running:
        raise DaqmxError(
            DAQmxErrors.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING,
            "Specified operation cannot be performed while the task is running: channels cannot be added.",
        )
    together = list(task.channels)
    for channel in channels:
        if channel.name.lower() in {other.name.lower() for other in together}:
            raise DaqmxError(
                DAQmxErrors.CHAN_ALREADY_IN_TASK,
                f"Channel specified already exists in the task: {channel.name!r}.",
            )
        homes = {c.device.chassis or c.device.name for c in (*together, channel)}
        if len(homes) > 1:
            raise DaqmxError(
                DAQmxErrors.MULTI_DEVS_IN_TASK,
                f"Specified operation cannot be performed when there are multiple devices in the task: "
                f"{', '.join(sorted(homes))}.",
            )
        if together and together[0].kind != channel.kind:
            raise DaqmxError(
                DAQmxErrors.MULTI_CHAN_TYPES_IN_TASK,
                "Specified operation cannot be performed when there are different channel types in the task: "
                f"{task.name!r} already has {task.kind} channels.",
            )
        together.append(channel)
    task.channels = together


_VOLTAGE_ONLY = ("E Series", "M Series", "X Series", "USB DAQ", "myDAQ", "AO Series")
"""Families whose outputs are voltages (inferred)."""
_FITS: dict[str, Callable[[NiDevice, str], bool]] = {
    "analog input": lambda device, tail: (
        f"{device.name}/{tail}" in device.ai or tail.startswith(("_ao", "_board"))
    ),
    "analog output": lambda _, tail: tail.startswith("ao"),
    "counter": lambda _, tail: "ctr" in tail,
}
"""What tells a terminal of each kind."""


def _new(system: NiSystem, request: Any, terminals: str, kind: str) -> Iterator[tuple[str, NiDevice, str]]:
    """Give the name, the device and the terminal of each channel to make. Raises DaqmxError."""
    resolved = list(system.inventory.resolve(terminals))
    names = channel_names(request.name_to_assign_to_channel, len(resolved))
    for number, (device, tail) in enumerate(resolved):
        if not _FITS[kind](device, tail):
            raise _wrong_kind(device, tail, kind)
        yield names[number] if names else f"{device.name}/{tail}", device, tail


def _limits(request: Any, kind: str, values: dict[str, Any]) -> None:
    values[f"{kind}_MIN"], values[f"{kind}_MAX"] = request.min_val, request.max_val


def _scale(system: NiSystem, name: str) -> Scale | None:
    return scale_named(system.scales, name) if name else None


def _terminal_config(device: NiDevice, tail: str, asked: int) -> int:
    number = device.ai_number(tail)
    if number is None:
        return int(TerminalConfiguration.DIFF.value)
    taken = device.product.configurations(number)
    if asked in (0, -1, TerminalConfiguration.DEFAULT.value):
        return int(CONFIGURATIONS[taken[0]].value)
    if TerminalConfiguration(asked) not in [CONFIGURATIONS[config] for config in taken]:
        raise unsupported(
            f"terminal configuration {TerminalConfiguration(asked).name} on {device.name}/{tail} of "
            f"{device.product.name}."
        )
    return asked


def _analog_input(call: str) -> Callable[[NiSystem, Any], None]:
    """Make the create call of analog inputs that is called `call`."""
    teds = call.startswith("CreateTEDS")
    row = MEASUREMENTS[
        call.removeprefix("CreateTEDS" if teds else "Create").removeprefix("AI").replace("Chan", "")
    ]

    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        given = request.DESCRIPTOR.fields_by_name
        where = (
            request.voltage_physical_channel
            if "voltage_physical_channel" in given
            else request.physical_channel
        )
        made = []
        for name, device, tail in _new(system, request, where, "analog input"):
            values: dict[str, Any] = {
                "AI_MEAS_TYPE": row.usage.value,
                "AI_MEAS_TYPE_NAME": row.usage.name,
                row.units: field(request, "units"),
                "AI_CUSTOM_SCALE_NAME": "",
                "AI_TERM_CFG": _terminal_config(device, tail, field(request, "terminal_config") or 0),
            }
            if "min_val" in given:
                _limits(request, "AI", values)
            for name_, property_ in (*FIELDS.items(), *_sensor(row).items()):
                if name_ in given:
                    value = field(request, name_)
                    is_list = hasattr(value, "__len__") and not isinstance(value, str)
                    values[property_] = list(value) if is_list else value
            if teds:
                values |= teds_values(system.teds, f"{device.name}/{tail}", row, values)
            if values.get("AI_CURRENT_SHUNT_LOC") == CurrentShuntResistorLocation.LET_DRIVER_CHOOSE.value:
                inside = tail == "dmm"
                where_ = (
                    CurrentShuntResistorLocation.INTERNAL if inside else CurrentShuntResistorLocation.EXTERNAL
                )
                values["AI_CURRENT_SHUNT_LOC"] = where_.value
            refuse_input(device, tail, values)
            if not measures(device.product.ai_measures, row.usage.name):
                raise _wrong_measurement(device, tail, row.usage.name)
            scale = _scale(system, values["AI_CUSTOM_SCALE_NAME"])
            physical: tuple[str, ...] = (tail,)
            if row.usage is UsageTypeAI.CALCULATED_POWER:
                physical += (_shunt(system, device, request.current_physical_channel),)
                products = [
                    values[f"AI_CALCULATED_POWER_VOLTAGE_{u}"] * values[f"AI_CALCULATED_POWER_CURRENT_{i}"]
                    for u in ("MIN", "MAX")
                    for i in ("MIN", "MAX")
                ]
                values["AI_MIN"], values["AI_MAX"] = min(products), max(products)
            made.append(Channel(name, "ai", device, physical, values, custom=scale))
        if row.usage is UsageTypeAI.ROSETTE_STRAIN_GAGE:
            made = _rosette(task, request, made)
        add(task, made)

    return create


def _shunt(system: NiSystem, device: NiDevice, where: str) -> str:
    """Return the input of `device` at whose shunt a calculated power's current is measured."""
    found = list(system.inventory.resolve(where))
    if len(found) != 1 or found[0][0] != device or f"{device.name}/{found[0][1]}" not in device.ai:
        raise DaqmxError(
            DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST,
            f"Physical channel specified does not exist on this device: {where!r} is not one analog input of "
            f"{device.name}, which measures the voltage.",
        )
    return found[0][1]


def _sensor(row: Measurement) -> dict[str, str]:
    if not row.sensor:
        return {}
    return {name: f"{row.sensor}_{name.upper()}" for name in ("sensitivity", "sensitivity_units")}


def _rosette(task: Task, request: Any, gages: list[Channel]) -> list[Channel]:
    """Return a rosette's channels: one for each measurement that is asked, of the gages together."""
    number = sum("principal" in c.name or "rosette" in c.name for c in task.channels)
    name = request.name_to_assign_to_channel or f"rosette{number}"
    kinds = [StrainGageRosetteMeasurementType(kind) for kind in request.rosette_meas_types]
    return [
        replace(gages[0], name=f"{name}_{_camel(kind.name)}", values={
            **gages[0].values, "AI_ROSETTE_STRAIN_GAGE_ROSETTE_MEAS_TYPE": kind.value
        })
        for kind in kinds
    ]  # fmt: skip


def _camel(name: str) -> str:
    first, *rest = name.lower().split("_")
    return first + "".join(part.capitalize() for part in rest)


def refuse_input(device: NiDevice, tail: str, values: dict[str, Any]) -> None:
    """Raise DaqmxError for a supply or a coupling that a product has not."""
    product = device.product
    supplies = product.ai_excitation or product.ai_bridge_excitation
    couplings = [Coupling[way.upper()].value for way in product.ai_couplings]
    wrong = ""
    if values.get("AI_EXCIT_SRC") == ExcitationSource.INTERNAL.value and not (
        supplies or "POSITION_LINEAR_LVDT" in product.ai_measures
    ):
        wrong = "internal excitation, which it does not supply"
    elif (
        values.get("AI_CURRENT_SHUNT_LOC") == CurrentShuntResistorLocation.INTERNAL.value
        and product.family in _VOLTAGE_ONLY
        and tail != "dmm"
    ):
        wrong = "an internal shunt resistor"
    elif values.get("AI_COUPLING") not in (None, 0, *couplings):
        wrong = f"{Coupling(values['AI_COUPLING']).name} coupling"
    if wrong:
        raise unsupported(f"{device.name}/{tail} of a {product.name}: {wrong}.")


def _analog_output(usage: UsageTypeAO, units: str) -> Callable[[NiSystem, Any], None]:
    """Make a create call of analog outputs; `units` is the property that holds theirs."""

    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        made = []
        for name, device, tail in _new(system, request, request.physical_channel, "analog output"):
            if usage is UsageTypeAO.CURRENT and device.product.family in _VOLTAGE_ONLY:
                raise _wrong_output(device, tail, usage.name)
            values: dict[str, Any] = {
                "AO_OUTPUT_TYPE": usage.value,
                units: field(request, "units"),
                "AO_CUSTOM_SCALE_NAME": request.custom_scale_name,
            }
            _limits(request, "AO", values)
            scale = _scale(system, request.custom_scale_name)
            made.append(Channel(name, "ao", device, (tail,), values, custom=scale))
        add(task, made)

    return create


def _function_generation(system: NiSystem, request: Any) -> None:
    task = system.task(request.task.name)
    made = []
    for name, device, tail in _new(system, request, request.physical_channel, "analog output"):
        if device.product.family in _VOLTAGE_ONLY:
            raise _wrong_output(device, tail, "FUNCTION_GENERATION")
        values: dict[str, Any] = {
            "AO_OUTPUT_TYPE": UsageTypeAO.FUNCTION_GENERATION.value,
            "AO_FUNC_GEN_TYPE": field(request, "type"),
            **{f"AO_FUNC_GEN_{of.upper()}": getattr(request, of) for of in ("freq", "amplitude", "offset")},
        }
        made.append(Channel(name, "ao", device, (tail,), values))
    add(task, made)


def _digital(kind: Kind) -> Callable[[NiSystem, Any], None]:
    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        together = field(request, "line_grouping") == LineGrouping.CHAN_FOR_ALL_LINES.value
        resolved = list(system.inventory.resolve(request.lines))
        if not together:
            # NI's reference of DAQmxCreateDIChan: a port's name alone means all its lines.
            resolved = [(device, line) for device, tail in resolved for line in device.lines_of(tail)]
        groups: list[tuple[NiDevice, tuple[str, ...], bool]] = []
        for device, tail in resolved:
            if not tail.startswith("port"):
                raise _wrong_kind(device, tail, "digital")
            _check_way(device, tail, "in" if kind == "di" else "out")
            # A whole port is listed from its highest line down.
            lines = tuple(reversed(device.lines_of(tail)))
            groups.append((device, lines, "/line" not in tail))
        if together and groups:
            device = groups[0][0]
            every = tuple(line for _, lines, _ in groups for line in lines)
            groups = [(device, every, all(whole for _, _, whole in groups))]
        names = _digital_names(request.name_to_assign_to_lines, groups, resolved)
        add(
            task,
            [
                Channel(name, kind, device, lines, ports=whole)
                for name, (device, lines, whole) in zip(names, groups, strict=True)
            ],
        )

    return create


def _check_way(device: NiDevice, tail: str, way: str) -> None:
    """Raise DaqmxError for a line or port that goes the other way only, as those of a USB-6211 do."""
    own = device.port_way(int(tail.partition("/")[0].removeprefix("port")))
    if own not in (way, "both"):
        raise DaqmxError(
            DAQmxErrors.INVALID_PHYS_CHAN_TYPE,
            "I/O type of the physical channel is incompatible with the I/O type required for the create "
            f"channel operation: {device.name}/{tail} of {device.product.name} is digital {own}put only.",
        )


def _digital_names(
    assigned: str, groups: list[tuple[NiDevice, tuple[str, ...], bool]], resolved: list[tuple[NiDevice, str]]
) -> list[str]:
    names = channel_names(assigned, len(groups))
    if names:
        return names
    if len(groups) == len(resolved):
        return [f"{device.name}/{tail}" for device, tail in resolved]
    # The driver's name of a channel with several lines.
    return [f"{resolved[0][0].name}/{resolved[0][1]}..."]


def _counter(call: str) -> Callable[[NiSystem, Any], None]:
    """Make the create call of counters that is called `call`."""
    row = COUNTERS[call]

    def create(system: NiSystem, request: Any) -> None:
        task = system.task(request.task.name)
        made = []
        for name, device, tail in _new(system, request, request.counter, "counter"):
            if row.kind == "co" and not device.product.puts_pulses:
                raise _wrong_kind(device, tail, "counter output")
            if row.usage is not UsageTypeCI.COUNT_EDGES and not device.product.puts_pulses:
                raise _wrong_measurement(device, tail, row.usage.name)
            values: dict[str, Any] = {
                "CI_MEAS_TYPE" if row.kind == "ci" else "CO_OUTPUT_TYPE": row.usage.value
            }
            values |= {name_: field(request, of) for of, name_ in row.properties.items()}
            source = f"{row.kind.upper()}_CTR_TIMEBASE_SRC"
            if values.get(source):
                values[source] = system.inventory.written(device, values[source])
            made.append(Channel(name, row.kind, device, (tail,), values, custom=_scale(
                system, values.get("CI_CUSTOM_SCALE_NAME", "")
            )))  # fmt: skip
        add(task, made)

    return create


def _wrong_kind(device: NiDevice, tail: str, kind: str) -> DaqmxError:
    return DaqmxError(
        DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST,
        f"Physical channel specified does not exist on this device: {device.name}/{tail} is not a channel "
        f"for {kind} of {device.product.name}.",
    )


def _wrong_output(device: NiDevice, tail: str, kind: str) -> DaqmxError:
    return DaqmxError(
        DAQmxErrors.PHYS_CHAN_OUTPUT_TYPE,
        f"Physical channel does not support the output type {kind}: {device.name}/{tail} of a "
        f"{device.product.name}.",
    )


def _wrong_measurement(device: NiDevice, tail: str, kind: str) -> DaqmxError:
    return DaqmxError(
        DAQmxErrors.PHYS_CHAN_MEAS_TYPE,
        f"Physical channel does not support the measurement type {kind}: {device.name}/{tail} of a "
        f"{device.product.name}.",
    )


CREATES: dict[str, Callable[[NiSystem, Any], None]] = {
    **{
        call: _analog_input(call)
        for call in pb.DESCRIPTOR.services_by_name["NiDAQmx"].methods_by_name
        if call.startswith(("CreateAI", "CreateTEDSAI"))
    },
    "CreateAOVoltageChan": _analog_output(UsageTypeAO.VOLTAGE, "AO_VOLTAGE_UNITS"),
    "CreateAOCurrentChan": _analog_output(UsageTypeAO.CURRENT, "AO_CURRENT_UNITS"),
    "CreateAOFuncGenChan": _function_generation,
    "CreateDIChan": _digital("di"),
    "CreateDOChan": _digital("do"),
    **{call: _counter(call) for call in COUNTERS},
}
"""Create calls that are served, by name."""
