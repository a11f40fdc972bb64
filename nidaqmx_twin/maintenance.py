"""Calls about a device's upkeep, and state that the NI system keeps beyond a task's run."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import LogicFamily, PowerUpChannelType, PowerUpStates, WDTTaskAction

from .errors import DaqmxError, DAQmxErrors, unsupported
from .names import field, names_in
from .reading import Alive, Call
from .scales import Scale, linear, mapped, polynomial, reverse_coefficients, scale_named, tabulated
from .storage import read_stored
from .system import NiSystem
from .tasks import Task
from .watchdog import Watchdog

_CALIBRATION: dict[str, Any] = {
    "SELF_CAL_SUPPORTED": True,
    "SELF_CAL_LAST_TEMP": 0.0,
    "EXT_CAL_LAST_TEMP": 0.0,
    "CAL_DEV_TEMP": 0.0,
    "EXT_CAL_RECOMMENDED_INTERVAL": 24,
    "CAL_USER_DEFINED_INFO": "",
    "CAL_USER_DEFINED_INFO_MAX_SIZE": 4,
    "CAL_ACC_CONNECTION_COUNT": 0,
    "CAL_RECOMMENDED_ACC_CONNECTION_COUNT_LIMIT": 0,
}
"""Calibration data of a device that no program has set (°C, months, characters). Temperatures are 0, as of
NI's simulated devices (NI's own tests); others are estimates."""


def read_calibration(system: NiSystem, name: str, request: Any) -> Any:
    """Return property `name` of the calibration of the request's device."""
    device = system.inventory.device(request.device_name)
    return system.upkeep.get((device.name, name), _CALIBRATION[name])


def write_calibration(system: NiSystem, name: str, request: Any, value: Any) -> None:
    """Set property `name` of the calibration of the request's device. Raises DaqmxError."""
    device = system.inventory.device(request.device_name)
    if isinstance(value, str) and len(value) > _CALIBRATION["CAL_USER_DEFINED_INFO_MAX_SIZE"]:
        raise unsupported(f"{value!r} is longer than 4.")
    system.upkeep[device.name, name] = value


def _dated(kind: str) -> Call:
    reply = getattr(pb, f"Get{kind}CalLastDateAndTimeResponse")

    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        device = system.inventory.device(request.device_name)
        when = system.upkeep.get((device.name, f"{kind} calibrated"), system.epoch)
        return reply(year=when.year, month=when.month, day=when.day, hour=when.hour, minute=when.minute)

    return call


def _self_calibrate(system: NiSystem, request: Any, alive: Alive) -> None:
    device = system.inventory.device(request.device_name)
    system.upkeep[device.name, "Self calibrated"] = datetime.now(UTC)


def _device_exists(system: NiSystem, request: Any, alive: Alive) -> None:
    system.inventory.device(request.device_name)


def _task_exists(system: NiSystem, request: Any, alive: Alive) -> None:
    """Do what a calibration of a simulated sensor does: nothing."""
    _ = system.task(request.task.name).kind


# States after power-on


def _lines(system: NiSystem, names: str) -> list[str]:
    lines = []
    for device, tail in system.inventory.resolve(names):
        lines += [line for line in device.lines if f"{line}/".startswith(f"{device.name}/{tail}/")]
    return lines


def _set_lines(of: str) -> Call:
    """Make a call that stores states of digital lines under `of`."""

    def call(system: NiSystem, request: Any, alive: Alive) -> None:
        for entry in getattr(request, of):
            for line in _lines(system, entry.channel_names):
                system.upkeep[line, of] = entry.state

    return call


def _get_lines(reply: type[Any], of: str, default: int) -> Call:
    def call(system: NiSystem, request: Any, alive: Alive) -> Any:
        states = [system.upkeep.get((_lines(system, name)[0], of), default) for name in request.channel_name]
        return reply(**{of: states})

    return call


def _set_family(system: NiSystem, request: Any, alive: Alive) -> None:
    device = system.inventory.device(request.device_name)
    system.upkeep[device.name, "logic family"] = field(request, "logic_family")


def _get_family(system: NiSystem, request: Any, alive: Alive) -> Any:
    device = system.inventory.device(request.device_name)
    family = system.upkeep.get((device.name, "logic family"), LogicFamily.FIVE_V.value)
    return pb.GetDigitalLogicFamilyPowerUpStateResponse(logic_family=family)


def _set_output(system: NiSystem, name: str, volts: float, kind: int) -> None:
    ((device, tail),) = system.inventory.resolve(name)
    low = 0.0 if device.product.ao_unipolar else -device.product.ao_range
    if f"{device.name}/{tail}" not in device.ao or not low <= volts <= device.product.ao_range:
        raise unsupported(f"{volts:g} V at {name}.")
    system.upkeep[f"{device.name}/{tail}", "power-up"] = (volts, kind)


def _set_outputs(system: NiSystem, request: Any, alive: Alive) -> None:
    names = names_in(request.channel_names)
    kinds = list(request.channel_type_array)
    for name, volts, kind in zip(names, request.state_array, kinds, strict=True):
        _set_output(system, name, volts, kind)


def _set_outputs_of_device(system: NiSystem, request: Any, alive: Alive) -> None:
    for entry in request.power_up_states:
        for name in names_in(entry.channel_names):
            _set_output(system, name, entry.state, field(entry, "channel_type"))


def _state(system: NiSystem, name: str) -> tuple[float, int]:
    ((device, tail),) = system.inventory.resolve(name)
    fallback = (0.0, PowerUpChannelType.CHANNEL_HIGH_IMPEDANCE.value)
    found: tuple[float, int] = system.upkeep.get((f"{device.name}/{tail}", "power-up"), fallback)
    return found


def _get_outputs(system: NiSystem, request: Any, alive: Alive) -> Any:
    states = [_state(system, name) for name in names_in(request.channel_names)]
    return pb.GetAnalogPowerUpStatesWithOutputTypeResponse(
        state_array=[volts for volts, _ in states],
        channel_type_array=[kind for _, kind in states],
        channel_type_array_raw=[kind for _, kind in states],
    )


def _get_outputs_of_device(system: NiSystem, request: Any, alive: Alive) -> Any:
    return pb.GetAnalogPowerUpStatesResponse(
        power_up_states=[_state(system, entry.channel_name)[0] for entry in request.channels]
    )


# Routes, networks, memories


def _connect(system: NiSystem, request: Any, alive: Alive) -> None:
    source, target = (
        _terminal(system, text) for text in (request.source_terminal, request.destination_terminal)
    )
    system.terminals.connect(source, target)


def _disconnect(system: NiSystem, request: Any, alive: Alive) -> None:
    system.terminals.disconnect(_terminal(system, request.destination_terminal))


def _terminal(system: NiSystem, text: str) -> str:
    head = text.lstrip("/").partition("/")[0]
    return system.inventory.terminal(system.inventory.device(head), f"/{text.lstrip('/')}")


def _unreachable(system: NiSystem, request: Any, alive: Alive) -> None:
    raise DaqmxError(
        DAQmxErrors.NETWORK_TARGET_NOT_FOUND,
        f"The network device cannot be found: nothing answers at {request.ip_address!r}.",
    )


def _remove(system: NiSystem, request: Any, alive: Alive) -> None:
    device = system.inventory.device(request.device_name)
    raise DaqmxError(
        DAQmxErrors.NETWORK_DAQ_DEVICE_NOT_SUPPORTED,
        f"{device.name} is no network device that was added, and cannot be removed.",
    )


def _no_memory(system: NiSystem, request: Any, alive: Alive) -> None:
    device = system.inventory.device(request.device_name)
    raise DaqmxError(
        DAQmxErrors.ID_PIN_NO_EEPROM, f"{device.name} has no memory at the ID pin {request.id_pin_name!r}."
    )


UPKEEP: dict[str, Call] = {
    "GetSelfCalLastDateAndTime": _dated("Self"),
    "GetExtCalLastDateAndTime": _dated("Ext"),
    "SelfCal": _self_calibrate,
    "RestoreLastExtCalConst": _device_exists,
    "PerformBridgeOffsetNullingCalEx": _task_exists,
    "PerformBridgeShuntCalEx": _task_exists,
    "PerformStrainShuntCalEx": _task_exists,
    "PerformThrmcplLeadOffsetNullingCal": _task_exists,
    "SetDigitalPowerUpStates": _set_lines("power_up_states"),
    "GetDigitalPowerUpStates": _get_lines(
        pb.GetDigitalPowerUpStatesResponse, "power_up_states", PowerUpStates.TRISTATE.value
    ),
    "SetDigitalPullUpPullDownStates": _set_lines("pull_up_pull_down_states"),
    "GetDigitalPullUpPullDownStates": _get_lines(
        pb.GetDigitalPullUpPullDownStatesResponse, "pull_up_pull_down_states", 15951
    ),
    "SetDigitalLogicFamilyPowerUpState": _set_family,
    "GetDigitalLogicFamilyPowerUpState": _get_family,
    "SetAnalogPowerUpStates": _set_outputs_of_device,
    "GetAnalogPowerUpStates": _get_outputs_of_device,
    "SetAnalogPowerUpStatesWithOutputType": _set_outputs,
    "GetAnalogPowerUpStatesWithOutputType": _get_outputs,
    "ConnectTerms": _connect,
    "DisconnectTerms": _disconnect,
    "AddNetworkDevice": _unreachable,
    "DeleteNetworkDevice": _remove,
    "ReserveNetworkDevice": _device_exists,
    "UnreserveNetworkDevice": _device_exists,
    "AddCDAQSyncConnection": lambda s, r, a: None,
    "RemoveCDAQSyncConnection": lambda s, r, a: None,
    "AutoConfigureCDAQSyncConnections": lambda s, r, a: None,
    "AreConfiguredCDAQSyncPortsDisconnected": lambda s, r, a: None,
    "GetAutoConfiguredCDAQSyncConnections": lambda s, r, a: None,
    "GetDisconnectedCDAQSyncPorts": lambda s, r, a: None,
    "ReadIDPinMemory": _no_memory,
    "WriteIDPinMemory": _no_memory,
}
"""Calls of this module, by name. A result of None means success."""


# State that the NI system keeps beyond a task's run: scales and watchdogs; properties of what it stores.


def read_kept(system: NiSystem, kind: str, name: str, request: Any) -> Any:
    """Return property `name` of the request's scale, saved task or watchdog, or None."""
    if kind in ("Scale", "PersistedScale"):
        return (
            request.scale_name
            if name == "ACTIVE_SCALE"
            else scale_named(system.scales, request.scale_name).get(name)
        )
    if kind in ("PersistedTask", "PersistedChan"):
        return read_stored(system, kind, name, request)
    if kind == "CalInfo":
        return read_calibration(system, name, request)
    watchdog = _watchdog(system, request)
    if name == "HAS_EXPIRED":
        return watchdog.expired(system.clock.now())
    return watchdog.get(request.lines, name)


def write_kept(system: NiSystem, kind: str, name: str, request: Any, value: Any) -> None:
    """Set property `name` of a scale or watchdog; None resets a watchdog's property."""
    if kind == "Scale":
        scale_named(system.scales, request.scale_name).set(name, value)
        return
    if kind == "CalInfo":
        write_calibration(system, name, request, value)
        return
    watchdog = _watchdog(system, request)
    watchdog.values.pop((request.lines, name), None)
    if value is not None:
        watchdog.values[request.lines, name] = value


# Scales


def _creating(make: Callable[[Any, dict[str, Any]], Scale]) -> Call:
    def call(system: NiSystem, request: Any, alive: Alive) -> None:
        common = {"SCALED_UNITS": request.scaled_units}
        if units := field(request, "pre_scaled_units"):
            common["PRE_SCALED_UNITS"] = units
        system.scales[request.name] = make(request, common)

    return call


def _reverse(system: NiSystem, request: Any, alive: Alive) -> Any:
    r = request
    found = reverse_coefficients(
        list(r.forward_coeffs), r.min_val_x, r.max_val_x, r.num_points_to_compute, r.reverse_poly_order
    )
    return pb.CalculateReversePolyCoeffResponse(reverse_coeffs=found)


# Watchdogs


def _watchdog(system: NiSystem, request: Any) -> Watchdog:
    task: Task = system.task(request.task.name)
    if task.watchdog is None:
        raise DaqmxError(
            DAQmxErrors.ACTION_NOT_SUPPORTED_TASK_NOT_WATCHDOG,
            f"Task {task.name!r} is not a watchdog timer task.",
        )
    return task.watchdog


def _create_watchdog(system: NiSystem, request: Any, alive: Alive) -> Any:
    watchdog = Watchdog(system.inventory.device(request.device_name), {("", "TIMEOUT"): request.timeout})
    task, new = system.create_task(request.session_name, request.initialization_behavior)
    if new:
        task.watchdog = watchdog
    reply = pb.CreateWatchdogTimerTaskExResponse(new_session_initialized=new)
    reply.task.name = task.session
    return reply


def _control_watchdog(system: NiSystem, request: Any, alive: Alive) -> None:
    _watchdog(system, request).control(WDTTaskAction(field(request, "action")), system.clock.now())


def _expiration(properties: dict[str, str]) -> Call:
    """Make a call that sets the outputs' expiration states; `properties` maps properties to fields."""

    def call(system: NiSystem, request: Any, alive: Alive) -> None:
        watchdog = _watchdog(system, request)
        names = names_in(request.channel_names)
        list(system.inventory.resolve(request.channel_names))
        for name, of in properties.items():
            for channel, value in zip(names, getattr(request, of), strict=True):
                watchdog.values[channel, name] = value

    return call


KEEPING: dict[str, Call] = {
    "CreateLinScale": _creating(lambda r, common: linear(r.slope, r.y_intercept, **common)),
    "CreateMapScale": _creating(
        lambda r, common: mapped(r.prescaled_min, r.prescaled_max, r.scaled_min, r.scaled_max, **common)
    ),
    "CreatePolynomialScale": _creating(
        lambda r, common: polynomial(list(r.forward_coeffs), list(r.reverse_coeffs), **common)
    ),
    "CreateTableScale": _creating(
        lambda r, common: tabulated(list(r.prescaled_vals), list(r.scaled_vals), **common)
    ),
    "CalculateReversePolyCoeff": _reverse,
    "CreateWatchdogTimerTaskEx": _create_watchdog,
    "ControlWatchdogTask": _control_watchdog,
    "CfgWatchdogDOExpirStates": _expiration({"DO_EXPIR_STATE": "expir_state_array"}),
    "CfgWatchdogCOExpirStates": _expiration({"CO_EXPIR_STATE": "expir_state_array"}),
    "CfgWatchdogAOExpirStates": _expiration(
        {"AO_EXPIR_STATE": "expir_state_array", "AO_OUTPUT_TYPE": "output_type_array"}
    ),
}
"""Calls of this module, by name."""
