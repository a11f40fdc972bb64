"""Checks of a task's triggers, filters, counters and timing, and of what it has set that is not simulated."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterator
from functools import partial

from nidaqmx.constants import (
    AcquisitionType,
    DigitalWidthUnits,
    Edge,
    SampleTimingType,
    TriggerType,
    UsageTypeCI,
)

from .channel import M_SERIES_FILTERS, Channel, counter_timebase, default_terminal, filter_of
from .errors import DaqmxError, DAQmxErrors, unserved, unsupported
from .names import names_in
from .properties import default_value
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


_FALLING_ONLY = ("USB-6008", "USB-6009")
"""Products that count falling edges (nidaqmx-python issue 448; USB-6008/6009 user guide, "Event Counter")."""
_ONE_COUNTER = ("E Series", "M Series", "AO Series", "USB DAQ")
"""Families whose tasks hold one counter input (nidaqmx, `add_ci_count_edges_chan`: "a task can contain only
one counter input channel" except on "devices that support multi-counter tasks"; inferred which are)."""
_OWN_CLOCK = ("NI 9361",)
"""Products whose counters have a sample clock of their own."""
_CLOCKED = (
    UsageTypeCI.COUNT_EDGES.value,
    UsageTypeCI.POSITION_ANGULAR_ENCODER.value,
    UsageTypeCI.POSITION_LINEAR_ENCODER.value,
)
_STEPS = (
    "CI_ANG_ENCODER_PULSES_PER_REV", "CI_LIN_ENCODER_DIST_PER_PULSE",
    "CI_VELOCITY_ANG_ENCODER_PULSES_PER_REV", "CI_VELOCITY_LIN_ENCODER_DIST_PER_PULSE",
)  # fmt: skip
"""What a pulse of an encoder is worth."""
_SLOWEST_HZ = 100e3
"""Slowest timebase of a counter (Hz)."""


def verify_counters(task: Task) -> None:
    """Check the settings of a counter task. Raises DaqmxError."""
    product, first = task.device.product, task.channels[0]
    if task.kind == "ci":
        if len(task.channels) > 1 and product.family in _ONE_COUNTER:
            raise DaqmxError(
                DAQmxErrors.MULTIPLE_COUNTER_INPUT_TASK,
                f"Task {task.name!r} has {len(task.channels)} counter inputs, and a {product.name} measures "
                "one in a task.",
            )
        clocked = task.timed and not task.implicit and first.values["CI_MEAS_TYPE"] not in _CLOCKED
        if clocked and product.family in _ONE_COUNTER:
            # Inferred: times by a sample clock are new with the X Series.
            raise unsupported(
                f"sample timing type of {task.name!r}: a {product.name} measures times by implicit timing."
            )
        unclocked = task.timed and not task.implicit and task.on_own_clock
        if unclocked and first.values["CI_MEAS_TYPE"] in _CLOCKED and product.name not in _OWN_CLOCK:
            raise DaqmxError(
                DAQmxErrors.EXT_SAMP_CLK_SRC_NOT_SPECIFIED,
                f"A counter has no sample clock of its own: name a source for task {task.name!r}, a PFI "
                "terminal or the clock of another task.",
            )
    elif task.timed and not task.implicit and task.on_own_clock and product.name not in _OWN_CLOCK:
        raise DaqmxError(
            DAQmxErrors.EXT_SAMP_CLK_SRC_NOT_SPECIFIED,
            f"A counter has no sample clock of its own: name a source for task {task.name!r}.",
        )
    for channel in task.channels:
        (_refuse_input if task.kind == "ci" else _refuse_pulses)(channel)


def _refuse_input(channel: Channel) -> None:
    values, product = channel.values, channel.product
    if values.get("CI_COUNT_EDGES_ACTIVE_EDGE") == Edge.RISING.value and product.name in _FALLING_ONLY:
        raise unsupported(
            f"CI_COUNT_EDGES_ACTIVE_EDGE of {channel.name!r}, a {product.name}, is falling only."
        )
    steps = [values.get(name, 1) for name in _STEPS]
    if not all(steps):
        raise unsupported(
            f"the pulses per revolution, or the distance per pulse, of {channel.name!r} are not 0."
        )
    low, high = values.get("CI_MIN"), values.get("CI_MAX")
    if low is not None and high is not None and not low < high:
        raise DaqmxError(
            DAQmxErrors.MIN_NOT_LESS_THAN_MAX,
            f"Minimum is greater than or equal to the maximum: {low:g}, {high:g} of {channel.name!r}.",
        )


def _refuse_pulses(channel: Channel) -> None:
    """Refuse pulses without a length, and a frequency that no timebase of the counter divides into.

    NI-DAQmx Base, text of -200745: timebase/maximum count <= frequency <= timebase/4.
    """
    values = channel.values
    hz, duty = values.get("CO_PULSE_FREQ"), values.get("CO_PULSE_DUTY_CYC", 0.5)
    spans = [
        values.get(f"CO_PULSE_{level}_{unit}", 1) for level in ("HIGH", "LOW") for unit in ("TIME", "TICKS")
    ]
    if (hz is not None and not hz > 0) or not 0 < duty < 1 or not min(spans) > 0:
        raise unsupported(
            f"pulses of {channel.name!r} need a frequency or times above 0, and a duty cycle between 0 and 1."
        )
    most = counter_timebase(channel.product.family) / 4
    least = _SLOWEST_HZ / 2.0**channel.product.counter_bits
    if hz is not None and "CO_CTR_TIMEBASE_SRC" not in channel.written and not least <= hz <= most:
        raise DaqmxError(
            DAQmxErrors.SUITABLE_TIMEBASE_NOT_FOUND_FREQUENCY_COMBO_2,
            f"Frequency and initial delay are inconsistent with the counter's timebases: {hz:g} Hz of "
            f"{channel.name!r}; a {channel.product.name} puts out {least:.3g} to {most:.3g} Hz.",
        )
    times = [values[name] for name in ("CO_PULSE_HIGH_TIME", "CO_PULSE_LOW_TIME") if name in values]
    if times and 1 / sum(times) > most:
        raise DaqmxError(
            DAQmxErrors.SUITABLE_TIMEBASE_NOT_FOUND_TIME_COMBO_2,
            f"High and low time are inconsistent with the counter's timebases: {min(times):g} s of "
            f"{channel.name!r}; a pulse of a {channel.product.name} takes at least {1 / most:.3g} s.",
        )


# Checks of how a task is timed, and of what is in it twice.

T = SampleTimingType
_TIMINGS = {"di": (T.CHANGE_DETECTION,), "ci": (T.IMPLICIT,), "co": (T.IMPLICIT,)}
"""Timings besides on demand and a sample clock, by kind of channels."""
_OLD_COUNTERS = ("E Series", "M Series", "AO Series", "USB DAQ")
"""Families whose counter outputs have no sample clock (inferred)."""


def refuse_timing(task: Task) -> None:
    """Refuse a timing that a kind of channels has not, in the words of pylibnidaqmx, issue 43."""
    kind, product = task.kind, task.device.product
    own = {T.ON_DEMAND, T.SAMPLE_CLOCK, *_TIMINGS.get(kind, ())}
    if product.family == "Digital I/O" and kind in ("di", "do"):
        own |= {T.HANDSHAKE, T.BURST_HANDSHAKE, T.PIPELINED_SAMPLE_CLOCK}
    if kind == "co" and product.family in _OLD_COUNTERS:
        own -= {T.SAMPLE_CLOCK}
    asked = T(task.setting("Timing", "SAMP_TIMING_TYPE", T.ON_DEMAND.value))
    if asked not in own:
        raise unsupported(
            f"sample timing type {asked.name} of task {task.name!r}; a {product.name} has "
            f"{', '.join(sorted(one.name for one in own))}."
        )
    if task.single_point and product.name.startswith("USB"):
        raise DaqmxError(
            DAQmxErrors.DEVICE_DOES_NOT_SUPPORT_HWTSP,
            f"Hardware-timed single points are not supported by {task.device.name}, a {product.name}.",
        )


def refuse_changes(task: Task) -> None:
    """Refuse to detect changes of no line, and of lines that are not in the task: NI's names of the codes."""
    edges = ("RISING", "FALLING") if task.detects_changes else ()
    listed = [
        str(task.setting("Timing", f"CHANGE_DETECT_DI_{edge}_EDGE_PHYSICAL_CHANS", "")) for edge in edges
    ]
    names = [name.lower() for text in listed for name in task.device.listed(text)]
    own = {f"{c.device.name}/{line}".lower() for c in task.channels for line in c.physical}
    if listed and not names:
        raise DaqmxError(
            DAQmxErrors.NO_CHANS_SPECD_FOR_CHANGE_DETECT,
            f"No lines were specified whose changes task {task.name!r} detects.",
        )
    for name in names:
        if not any(f"{line}/".startswith(f"{name}/") for line in own):
            raise DaqmxError(
                DAQmxErrors.CHANGE_DETECTION_CHAN_NOT_IN_TASK,
                f"Line whose changes are detected is not in the task {task.name!r}: {name}.",
            )


def refuse_repeated(task: Task) -> None:
    """Refuse an output that is twice in a task: NI's name of the code."""
    if task.is_input:
        return
    found: set[tuple[str, str]] = set()
    for channel in task.channels:
        for physical in channel.physical:
            if (channel.device.name, physical) in found:
                raise DaqmxError(
                    DAQmxErrors.DUPLICATE_PHYSICAL_CHANS_NOT_SUPPORTED,
                    f"Duplicate physical channels are not supported: {channel.device.name}/{physical} in "
                    f"task {task.name!r}.",
                )
            found.add((channel.device.name, physical))
