"""Checks of triggers, of digital filters and of what a task has set that is not simulated."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterator
from functools import partial

from nidaqmx.constants import AcquisitionType, DigitalWidthUnits, TriggerType

from .channel import M_SERIES_FILTERS, default_terminal, filter_of
from .defaults import default_value
from .errors import DaqmxError, DAQmxErrors, unserved, unsupported
from .names import names_in
from .tasks import Task

_INFIX = {
    TriggerType.DIGITAL_LEVEL.value: "DIG_LVL",
    TriggerType.ANALOG_LEVEL.value: "ANLG_LVL",
    TriggerType.ANALOG_EDGE.value: "ANLG_EDGE",
    TriggerType.ANALOG_WINDOW.value: "ANLG_WIN",
    TriggerType.ANALOG_MULTI_EDGE.value: "ANLG_MULTI_EDGE",
    TriggerType.DIGITAL_PATTERN.value: "DIG_PATTERN",
}
"""Triggers that are not simulated, and what is in the names of their properties."""
_UNFOLLOWED = re.compile(
    r"AI_(LOWPASS|HIGHPASS|BANDPASS|FILTER|DIG_FLTR)_ENABLE|AI_(PROBE_ATTEN|AVERAGING_WIN_SIZE)"
    r"|AI_EXCIT_USE_FOR_SCALING|AI_BRIDGE_INITIAL_\w+|AI_LEAD_WIRE_RESISTANCE|CI_PRESCALER"
    r"|CI_(FREQ|PERIOD)_ENABLE_AVERAGING|DI_DIG_FLTR_ENABLE"
)
"""Properties of channels that would change what a driven input reads, and do not here."""
_DEFAULTS = {"AI_PROBE_ATTEN": 1.0, "AI_AVERAGING_WIN_SIZE": 1, "CI_PRESCALER": 1}
_LEAST = 2
"""Samples before and after a reference trigger (NI's default; that there is no less is inferred)."""
_NO_FILTERS = ("E Series", "AO Series", "USB DAQ", "myDAQ")
"""Families without digital filters at their terminals (inferred)."""
_ONE_START = ("E Series", "M Series", "AO Series", "USB DAQ", "myDAQ")
"""Families whose acquisitions start once (inferred: the X Series manual has "Retriggerable Analog Input")."""


def verify_triggers(task: Task) -> None:
    """Check the triggers and filters of a task. Raises DaqmxError."""
    for kind, source in (
        *(("Trig", f"DIG_EDGE_{which}_TRIG_SRC") for which in ("START", "REF", "ARM_START")),
        ("Timing", "SAMP_CLK_SRC"),
    ):
        _refuse_filter(task, filter_of(source), partial(task.setting, kind))
    for channel in task.channels:
        for name in sorted(channel.written):
            if name.endswith("_DIG_FLTR_ENABLE") and task.kind != "ai":
                _refuse_filter(task, name.removesuffix("_ENABLE"), channel.values.get)
    _refuse_delay(task)
    _refuse_retriggers(task)
    _refuse_pretrigger(task)


def _refuse_filter(task: Task, name: str, value: Callable[[str], object]) -> None:
    if not value(f"{name}_ENABLE"):
        return
    product, width = task.device.product, value(f"{name}_MIN_PULSE_WIDTH")
    if product.family in _NO_FILTERS:
        raise DaqmxError(
            DAQmxErrors.DIG_FILTER_NOT_AVAILABLE_ON_TERM,
            f"Digital filter is not available on the terminal: a {product.name} has none ({name}_ENABLE).",
        )
    if not width:
        raise DaqmxError(
            DAQmxErrors.DIG_FILTER_ENABLED_MIN_PULSE_WIDTH_NOT_CFG,
            f"Digital filter has been enabled, and its minimum pulse width has not been set: {name} of "
            f"{task.name!r}.",
        )
    if value(name.replace("_FLTR", "_SYNC") + "_ENABLE"):
        raise DaqmxError(
            DAQmxErrors.DIG_FILTER_AND_SYNC_BOTH_ENABLED,
            f"Digital filter and digital synchronization cannot both be enabled: {name} of {task.name!r}.",
        )
    if product.family == "M Series" and float(str(width)) > M_SERIES_FILTERS[-1] * (1 + 1e-9):
        raise unsupported(
            f"{name}_MIN_PULSE_WIDTH of {float(str(width)):g} s; a {product.name} has 125 ns, 6.425 us and "
            "2.56 ms."
        )


def _refuse_delay(task: Task) -> None:
    """Refuse a delay from the start trigger where NI's names of the codes say that there is none."""
    delay = float(task.setting("Trig", "START_TRIG_DELAY", 0.0))
    if not delay:
        return
    units = task.setting("Trig", "START_TRIG_DELAY_UNITS", DigitalWidthUnits.SAMPLE_CLOCK_PERIODS.value)
    if task.kind in ("ci", "co"):
        code, why = DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT, "counters have none"
    elif task.device.product.delta_sigma or task.device.product.family == "DSA":
        code, why = DAQmxErrors.START_TRIG_DELAY_WITH_DSA_MODULE, "dynamic signal inputs have none"
    elif not task.on_own_clock:
        code, why = DAQmxErrors.START_TRIG_DELAY_WITH_EXT_SAMP_CLK, "the sample clock is another's"
    elif delay < 0 or (units == DigitalWidthUnits.TICKS.value and delay < 2):
        code, why = DAQmxErrors.DELAY_FROM_START_TRIG_TOO_SHORT, "it takes at least 2 ticks of the timebase"
    else:
        return
    raise DaqmxError(code, f"Start trigger delay of {delay:g} of task {task.name!r} is not possible: {why}.")


def _refuse_retriggers(task: Task) -> None:
    if task.setting("Trig", "REF_TRIG_RETRIGGERABLE", False):
        # X Series manual 370784: "Reference triggers are not retriggerable."
        raise _unsupported(task, "REF_TRIG_RETRIGGERABLE")
    if not task.retriggered:
        return
    family = task.device.product.family
    finite = task.setting("Timing", "SAMP_QUANT_SAMP_MODE") == AcquisitionType.FINITE.value
    if task.kind == "ci" or (task.kind != "co" and family in _ONE_START):
        raise _unsupported(task, "START_TRIG_RETRIGGERABLE")
    if task.kind == "co" and finite and family in _ONE_START:
        raise DaqmxError(
            DAQmxErrors.RETRIGGERING_FINITE_CO_NOT_ALLOWED,
            f"A finite generation of a {task.device.product.name}'s counters cannot be started again: task "
            f"{task.name!r}. Leave its timing out for one pulse at each trigger.",
        )
    if task.pretrigger is not None or (task.timed and not finite):
        raise DaqmxError(
            DAQmxErrors.RETRIGGERING_INVALID_FOR_GIVEN_SETTINGS,
            f"Task {task.name!r} cannot be started again at each trigger: that takes a finite number of "
            "samples, and no reference trigger.",
        )


def _refuse_pretrigger(task: Task) -> None:
    """Refuse a reference trigger with what it does not go with, by NI's names of the codes."""
    if task.pretrigger is None:
        return
    before, asked, reason = task.pretrigger, task.samples_asked, ""
    if task.setting("Timing", "SAMP_QUANT_SAMP_MODE") != AcquisitionType.FINITE.value:
        code, reason = DAQmxErrors.REF_TRIG_WHEN_CONTINUOUS, "its samples are continuous: make them finite"
    elif task.setting("Trig", "PAUSE_TRIG_TYPE", TriggerType.NONE.value) != TriggerType.NONE.value:
        code, reason = DAQmxErrors.REF_AND_PAUSE_TRIG_CONFIGURED, "it has a pause trigger as well"
    elif before < _LEAST:
        code, reason = DAQmxErrors.INVALID_ATTRIBUTE_VALUE, f"it needs {_LEAST} samples before, not {before}"
    elif before + _LEAST > asked:
        code = DAQmxErrors.TOO_MANY_PRETRIG_PLUS_MIN_POST_TRIG_SAMPS
        reason = f"{before} samples before it, and at least {_LEAST} after, are more than {asked}"
    if reason:
        raise DaqmxError(code, f"Task {task.name!r} cannot have its reference trigger: {reason}.")


def _unsupported(task: Task, name: str) -> DaqmxError:
    return DaqmxError(
        DAQmxErrors.ATTRIBUTE_NOT_SUPPORTED_IN_TASK_CONTEXT,
        "Specified property is not supported by the device or is not applicable to the task: "
        f"{name} of {task.name!r}, on a {task.device.product.name}.",
    )


def refuse_unfollowed(task: Task, wired: Container[str], driven: Callable[[str], bool]) -> None:
    """Refuse what would be passed over, so that what is read would not be a card's: a trigger or a gate by
    something that is `driven`, and a property of an input that is. By one that nothing drives, it warns.
    """
    _refuse_unfollowed_retriggers(task, driven)
    for name, source in _gates(task):
        if source and driven(_terminal(task, source)):
            raise _not_followed(task, name, _terminal(task, source))
    for channel in task.channels:
        inputs = [f"{channel.device.name}/{physical}" for physical in channel.physical]
        inputs += [
            str(channel.values[name]).lstrip("/") for name in channel.written if name.endswith("_TERM")
        ]
        if not any(name in wired or driven(f"/{name}") for name in inputs):
            continue
        for name in sorted(channel.written):
            value = channel.values.get(name)
            usual = (0, _DEFAULTS.get(name, default_value("Chan", "Int32", name)))
            if _UNFOLLOWED.fullmatch(name) and value not in usual and not task.detects_changes:
                raise _not_followed(task, name, inputs[0])
        if task.kind == "ai" and task.setting("Timing", "DELAY_FROM_SAMP_CLK_DELAY"):
            raise _not_followed(task, "DELAY_FROM_SAMP_CLK_DELAY", inputs[0])


def _refuse_unfollowed_retriggers(task: Task, driven: Callable[[str], bool]) -> None:
    """Refuse to start a task again at triggers that nothing drives, outputs, and on a clock of another."""
    if not task.retriggered:
        return
    source = str(task.setting("Trig", "DIG_EDGE_START_TRIG_SRC", ""))
    digital = task.setting("Trig", "START_TRIG_TYPE") == TriggerType.DIGITAL_EDGE.value
    terminal = task.device.full(source)
    comes = driven(terminal) or terminal.endswith(("InternalOutput", "StartTrigger"))
    if task.kind in ("ao", "do") or not (digital and comes and task.on_own_clock):
        raise _not_followed(task, "START_TRIG_RETRIGGERABLE", source)


def _gates(task: Task) -> Iterator[tuple[str, str]]:
    """Give the name of the property and each terminal of triggers and gates that are not simulated."""
    for which in ("START", "REF", "PAUSE"):
        infix = _INFIX.get(task.setting("Trig", f"{which}_TRIG_TYPE"))
        for name in (f"{infix}_{which}_TRIG_SRC", f"{infix}_{which}_TRIG_SRCS") if infix else ():
            for source in names_in(str(task.setting("Trig", name, ""))):
                yield name, source
    for channel in task.channels:
        for gate in ("COUNT_RESET", "GATE"):
            if channel.values.get(f"CI_COUNT_EDGES_{gate}_ENABLE"):
                name = f"CI_COUNT_EDGES_{gate}_TERM"
                yield name, str(channel.values.get(name, ""))
        timebase = f"{channel.kind.upper()}_CTR_TIMEBASE_SRC"
        source = str(channel.values.get(timebase) or "")
        if source and not source.endswith(("Timebase", "OnboardClock")):
            yield timebase, source
        if channel.values.get("CI_ENCODER_Z_INDEX_ENABLE"):
            name = "CI_ENCODER_Z_INPUT_TERM"
            yield name, str(channel.values.get(name) or default_terminal(channel, "gate") or "")


def _terminal(task: Task, source: str) -> str:
    """Full name of a trigger's source: a channel of the task, an input, a line or a terminal."""
    own = {channel.name: f"/{channel.device.name}/{channel.physical[0]}" for channel in task.channels}
    if source in own:
        return own[source]
    known = any(source.lstrip("/").startswith(f"{device.name}/") for device in task.devices)
    return f"/{source.lstrip('/')}" if known else task.device.full(source)


def _not_followed(task: Task, name: str, where: str) -> DaqmxError:
    return unserved(f"the twin does not follow {name} ({where}) of task {task.name!r}.")
