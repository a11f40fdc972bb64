"""State that the NI system keeps beyond a task's run: scales and watchdogs; properties of what it stores."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import WDTTaskAction

from .errors import DaqmxError, DAQmxErrors
from .fields import field
from .names import names_in
from .scales import Scale, linear, mapped, polynomial, reverse_coefficients, tabulated
from .storage import read_stored
from .system import NiSystem
from .taking import Alive, Call
from .tasks import Task
from .upkeep import read_calibration, write_calibration
from .watchdog import Watchdog


def read_kept(system: NiSystem, kind: str, name: str, request: Any) -> Any:
    """Return property `name` of the request's scale, saved task or watchdog, or None."""
    if kind in ("Scale", "PersistedScale"):
        return request.scale_name if name == "ACTIVE_SCALE" else _scale(system, request.scale_name).get(name)
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
        _scale(system, request.scale_name).set(name, value)
        return
    if kind == "CalInfo":
        write_calibration(system, name, request, value)
        return
    watchdog = _watchdog(system, request)
    watchdog.values.pop((request.lines, name), None)
    if value is not None:
        watchdog.values[request.lines, name] = value


# Scales


def _scale(system: NiSystem, name: str) -> Scale:
    if name not in system.scales:
        raise DaqmxError(
            DAQmxErrors.CUSTOM_SCALE_DOES_NOT_EXIST, f"Custom scale specified does not exist: {name!r}."
        )
    return system.scales[name]


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
