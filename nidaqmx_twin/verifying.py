"""Checks of the combination of a task's settings, as the driver makes them when it verifies a task."""

from __future__ import annotations

import re
from collections.abc import Callable, Container

from nidaqmx.constants import CJCSource, LoggingMode, TemperatureUnits, ThermocoupleType

from .channel import Channel
from .checks import (
    refuse_changes,
    refuse_repeated,
    refuse_timing,
    refuse_unfollowed,
    verify_counters,
    verify_triggers,
)
from .devices import Inventory
from .errors import DaqmxError, DAQmxErrors, DAQmxWarnings, unserved, unsupported
from .tasks import Task

_LEAST_BUFFER = 2
"""Samples per channel of an output buffer (ZhuangLab/storm-control, issue 113: "Minimum Supported Value")."""
_STATIC_LINES = ("E Series", "USB DAQ")
"""Families whose lines have no sample clock (pylibnidaqmx, issue 43; USB-6008/6009 user guide, "Static DIO").
NI-DAQmx Device Considerations, "Bus-Powered M Series Physical Channels": nor have those."""
_PORT_0_ONLY = ("M Series", "X Series")
"""Families of whose ports the first has a sample clock (NI-DAQmx Device Considerations, "M Series Physical
Channels"; products.toml, `ports`)."""
_STATIC_PRODUCTS = ("PCI-6713",)
_LINES_HZ = {"PCI-6251": 10e6, "PCI-6733": 10e6, "PCIe-6343": 1e6, "PCIe-6363": 10e6}
"""Most updates of digital lines (1/s), and products whose lines have none (labscript-devices,
models/capabilities.json, measured)."""
_THERMOCOUPLES = {
    ThermocoupleType.B.value: (0.0, 1820.0),
    ThermocoupleType.E.value: (-270.0, 1000.0),
    ThermocoupleType.J.value: (-210.0, 1200.0),
    ThermocoupleType.K.value: (-270.0, 1372.0),
    ThermocoupleType.N.value: (-270.0, 1300.0),
    ThermocoupleType.R.value: (-50.0, 1768.1),
    ThermocoupleType.S.value: (-50.0, 1768.1),
    ThermocoupleType.T.value: (-270.0, 400.0),
}
"""Temperatures of each type's reference function (°C; NIST Monograph 175, ITS-90)."""
_CELSIUS: dict[int, Callable[[float], float]] = {
    TemperatureUnits.DEG_C.value: lambda value: value,
    TemperatureUnits.DEG_F.value: lambda value: (value - 32) / 1.8,
    TemperatureUnits.K.value: lambda value: value - 273.15,
    TemperatureUnits.DEG_R.value: lambda value: value / 1.8 - 273.15,
}
_VOLTS = (
    "VOLTAGE",
    "VOLTAGE_CUSTOM_WITH_EXCITATION",
    "POWER",
    "CALCULATED_POWER",
    "TEMPERATURE_BUILT_IN_SENSOR",
)
"""Measurements that need no law from volts to their units."""


def verify(task: Task) -> None:
    """Check a task's settings; its `warning` is then what the driver warns of. Raises DaqmxError."""
    kind, task.warning = task.kind, 0
    for channel in task.channels if kind in ("ai", "ao") else ():
        if not channel.low < channel.high:
            # Channels are made with it: nidaqwrapper's tests on NI's simulated devices.
            raise DaqmxError(
                DAQmxErrors.MIN_NOT_LESS_THAN_MAX,
                f"Minimum is greater than or equal to the maximum: {channel.low:g}, {channel.high:g} of "
                f"{channel.name!r}.",
            )
        if kind == "ao":
            _ = channel.full_scale
    refuse_timing(task)
    refuse_repeated(task)
    if task.has_start_trigger and not task.timed and kind not in ("co", "ci"):
        raise DaqmxError(
            DAQmxErrors.TRIG_WHEN_ON_DEMAND_SAMP_TIMING,
            f"Task {task.name!r} has a trigger, but its timing is on demand: set a sample clock.",
        )
    if (
        task.timed
        and kind == "ao"
        and not task.single_point
        and task.setting("Buffer", "OUTPUT_BUF_SIZE") == 0
    ):
        raise DaqmxError(
            DAQmxErrors.AO_BUFFER_SIZE_ZERO_FOR_SAMP_CLK_TIMING_TYPE,
            f"Task {task.name!r} has a sample clock and an output buffer of size 0: set the size, or time "
            "its samples on demand or as hardware-timed single points.",
        )
    if task.timed and kind in ("ai", "ao"):
        _refuse_rate(task)
        for channel in task.channels:
            _ = channel.full_scale
    verify_triggers(task)
    _refuse_interval(task)
    _refuse_logging(task)
    if kind == "ai":
        _refuse_on_demand(task)
        _refuse_temperatures(task)
    elif kind in ("ci", "co"):
        verify_counters(task)
    elif kind in ("di", "do"):
        _refuse_clocked_lines(task)
        _refuse_fast_lines(task)
    if task.total is not None and task.timed and kind not in ("ci", "co") and task.samples_asked < 2:
        raise unsupported("a finite task needs at least 2 samples per channel.")


def refuse_unsimulated(task: Task, wired: Container[str], driven: Callable[[str], bool]) -> None:
    """Refuse what would be computed as a card does not; `wired` and `driven` say what is connected."""
    refuse_changes(task)
    _refuse_unscaled(task, wired)
    refuse_unfollowed(task, wired, driven)


def _refuse_rate(task: Task) -> None:
    """Refuse a rate that the converters cannot do, and warn of one at which their inputs do not settle."""
    product, channels = task.device.product, len(task.channels)
    if task.kind == "ao":
        most = settled = product.ao_rate_hz
        if not most:
            raise unsupported(
                f"sample timing type of {task.device.name}: the outputs of a {product.name} have no sample "
                "clock."
            )
    elif product.ai_simultaneous or channels == 1:
        most = settled = product.ai_rate_single_hz
    else:
        most, settled = product.ai_rate_single_hz / channels, product.ai_rate_hz / channels
    if task.rate_hz > most * (1 + 1e-9):
        raise DaqmxError(
            DAQmxErrors.SAMP_RATE_TOO_HIGH,
            f"Sample rate {task.rate_hz:g} Hz is above what {task.device.name} "
            f"({product.name}) can do with {channels} channels: {most:g} Hz.",
        )
    conversions = float(task.setting("Timing", "AI_CONV_RATE", 0.0)) if task.kind == "ai" else 0.0
    if not product.ai_simultaneous and conversions > product.ai_rate_single_hz * (1 + 1e-9):
        raise DaqmxError(
            DAQmxErrors.AI_CONV_RATE_TOO_HIGH,
            f"Conversion rate {conversions:g} Hz is above what {task.device.name} ({product.name}) can do.",
        )
    if task.rate_hz > settled * (1 + 1e-9):
        task.warning = DAQmxWarnings.RATE_VIOLATES_SETTLING_TIME.value
    if task.kind == "ai" and task.rate_hz < product.ai_rate_least_hz * (1 - 1e-3):
        raise DaqmxError(
            DAQmxErrors.SAMP_RATE_TOO_LOW,
            f"Sample rate {task.rate_hz:g} Hz is below what {task.device.name} ({product.name}) "
            f"can do: {product.ai_rate_least_hz:g} Hz.",
        )


def _refuse_interval(task: Task) -> None:
    """Refuse an interval of events that the buffer cannot serve.

    NI-DAQmx help, "Software Events": with DMA it divides the buffer evenly on AO, E and M Series.
    """
    if task.every and not task.timed and task.kind in ("ai", "ao", "di", "do"):
        raise DaqmxError(
            DAQmxErrors.EVERY_N_SAMPLES_EVENT_NOT_SUPPORTED_FOR_NON_BUFFERED_TASKS,
            f"Task {task.name!r} has an every N samples event, but no buffer: set a sample clock.",
        )
    if not task.every or not task.timed or not task.is_input:
        return
    product, size = task.device.product, task.buffer_size
    divides = product.family in ("AO Series", "E Series", "M Series") and not product.name.startswith("USB")
    if task.every > size or (divides and size % task.every):
        raise DaqmxError(
            DAQmxErrors.BUFFER_SIZE_NOT_MULTIPLE_OF_EVERY_N_SAMPS_EVENT_INTERVAL_WHEN_DMA,
            f"Events of every {task.every} samples do not fit a buffer of {size} samples per channel: "
            "the interval must divide the buffer. Set the buffer's size, or another interval.",
        )


def _refuse_clocked_lines(task: Task) -> None:
    """Refuse to clock digital lines that are read and written by the program only."""
    for channel in task.channels if task.timed else ():
        product = channel.product
        static = product.family in _STATIC_LINES or product.port_ways == ("in", "out")
        static |= product.name in _STATIC_PRODUCTS
        static |= product.family in _PORT_0_ONLY and not task.detects_changes and _beyond_port_0(channel)
        if static:
            raise unsupported(
                f"sample timing type of {channel.name!r}: the digital lines of a {product.name} are timed on "
                "demand."
            )
        if product.family == "M Series" and not task.detects_changes and task.on_own_clock:
            raise DaqmxError(
                DAQmxErrors.EXT_SAMP_CLK_SRC_NOT_SPECIFIED,
                f"Digital lines of a {product.name} have no sample clock of their own: name a source for "
                f"task {task.name!r}.",
            )


def _refuse_on_demand(task: Task) -> None:
    """Refuse to read a dynamic signal card without a sample clock: daqmx, issue 3 (a USB-4431)."""
    if not task.timed and task.device.product.family == "DSA":
        raise DaqmxError(
            DAQmxErrors.INVALID_TIMING_TYPE,
            "Sample Timing Type is set to On Demand, which is not supported for analog input on "
            f"{task.device.name}, a {task.device.product.name}: set a sample clock.",
        )


def _refuse_logging(task: Task) -> None:
    """Refuse to log what is not acquired into a buffer, by NI's names of the codes."""
    if task.setting("Read", "LOGGING_MODE", LoggingMode.OFF.value) == LoggingMode.OFF.value:
        return
    if not task.is_input:
        code, why = DAQmxErrors.LOGGING_NOT_SUPPORT_ON_OUTPUT_TASKS, "has outputs"
    elif not task.timed:
        code, why = DAQmxErrors.LOGGING_MODE_NOT_SUPPORTED_NON_BUFFERED, "has no buffer: set a sample clock"
    elif task.kind != "ai":
        code, why = DAQmxErrors.ATTR_NOT_SUPPORTED, "is none of analog inputs, and the twin logs no other"
    else:
        return
    raise DaqmxError(code, f"Logging is not supported: task {task.name!r} {why}.")


def _refuse_fast_lines(task: Task) -> None:
    most = _LINES_HZ.get(task.device.product.name)
    if task.timed and task.kind == "do" and most is not None and task.rate_hz > most * (1 + 1e-9):
        raise DaqmxError(
            DAQmxErrors.SAMP_RATE_TOO_HIGH,
            f"Sample rate {task.rate_hz:g} Hz is above what the lines of {task.device.name} "
            f"({task.device.product.name}) can do: {most:g} Hz.",
        )


def _beyond_port_0(channel: Channel) -> bool:
    return any(line.startswith("port") and not line.startswith("port0") for line in channel.physical)


def _refuse_thermocouple(channel: Channel) -> None:
    """Refuse limits beyond the temperatures of a type's law from volts to degrees."""
    units, kind = channel.values.get("AI_TEMP_UNITS"), channel.values.get("AI_THRMCPL_TYPE")
    if units not in _CELSIUS or kind not in _THERMOCOUPLES:
        return
    low, high = _THERMOCOUPLES[kind]
    asked = [_CELSIUS[units](limit) for limit in (channel.low, channel.high)]
    if not low <= min(asked) <= max(asked) <= high:
        raise unsupported(
            f"{min(asked):g} to {max(asked):g} °C of {channel.name!r}; type {ThermocoupleType(kind).name} "
            f"measures {low:g} to {high:g} °C."
        )


def refuse_terminals(inventory: Inventory, task: Task) -> None:
    """Refuse a counter's terminal, or one to which a signal is exported, that no device has."""
    source = DAQmxErrors.INVALID_ROUTING_SOURCE_TERMINAL_NAME_ROUTING
    destination = DAQmxErrors.INVALID_ROUTING_DESTINATION_TERMINAL_NAME_ROUTING
    for channel in task.channels:
        for name in (*channel.written, f"{channel.kind.upper()}_CTR_TIMEBASE_SRC"):
            value = str(channel.values.get(name) or "")
            if name.endswith(("_TERM", "_CTR_TIMEBASE_SRC")) and value and not value.endswith("OnboardClock"):
                out = name.startswith("CO_") and name.endswith("_TERM")
                full = inventory.terminal(channel.device, value, destination if out else source)
                _refuse_way(channel, full, out)
    for (kind, name), terminal in task.settings.items():
        if kind == "ExportedSignal" and name.endswith("_OUTPUT_TERM") and terminal:
            inventory.terminal(task.device, terminal, destination)


def _refuse_way(channel: Channel, terminal: str, out: bool) -> None:
    """Refuse to count at a terminal of the channel's device that only puts out, or the other way round."""
    found = re.fullmatch(rf"/{re.escape(channel.device.name)}/PFI(\d+)", terminal, re.IGNORECASE)
    if found and channel.product.pfi_way(int(found[1])) == ("in" if out else "out"):
        raise DaqmxError(
            DAQmxErrors.ROUTE_NOT_SUPPORTED_BY_HW_ROUTING,
            f"Specified route cannot be satisfied, because the hardware does not support it: {terminal} of a "
            f"{channel.product.name} is an {'input' if out else 'output'}.",
        )


def refuse_auto_start(task: Task, auto: bool) -> None:
    """Refuse to start a task by a read or write where its events are registered: NI's names of the codes."""
    if auto and task.heard:
        kind = "READ" if task.is_input else "WRITE"
        raise DaqmxError(
            DAQmxErrors[f"AUTO_START_{kind}_NOT_ALLOWED_EVENT_REGISTERED"],
            f"Task {task.name!r} has events, and is not started by a read or write: start it before.",
        )


def refuse_small_buffer(task: Task) -> None:
    """Refuse to start a generation from a buffer of one sample, or an acquisition into one of none."""
    if task.is_input and task.timed and not task.single_point and task.buffer_size == 0:
        raise DaqmxError(
            DAQmxErrors.INPUT_BUF_SIZE_TOO_SMALL_TO_START_ACQ,
            f"Acquisition cannot be started, because the selected buffer size is too small: {task.name!r} "
            "has an input buffer of 0 samples per channel.",
        )
    plays = not task.is_input and task.timed and task.kind != "co" and not task.single_point
    if plays and task.buffer.shape[1] < _LEAST_BUFFER:
        raise DaqmxError(
            DAQmxErrors.OUTPUT_BUF_SIZE_TOO_SMALL_TO_START_GEN,
            f"The generation of {task.name!r} cannot be started, because its buffer of 1 sample per channel "
            f"is too small: at least {_LEAST_BUFFER} are needed.",
        )


def _refuse_unscaled(task: Task, wired: Container[str]) -> None:
    """Refuse volts that somebody drives into a measurement whose law is not simulated: they would be shown as
    degrees or strain.
    """
    for channel in task.channels if task.kind == "ai" else ():
        usage = channel.values.get("AI_MEAS_TYPE_NAME", "VOLTAGE")
        if (
            usage not in _VOLTS
            and channel.scale is None
            and f"{channel.device.name}/{channel.physical[0]}" in wired
        ):
            raise unserved(
                f"the twin does not turn volts at {channel.name!r} into what a channel of the kind {usage} "
                "shows. Leave its input undriven, or measure voltage."
            )


def _refuse_temperatures(task: Task) -> None:
    for channel in task.channels:
        _refuse_thermocouple(channel)
        scanned = channel.values.get("AI_THRMCPL_CJC_SRC") == CJCSource.SCANNABLE_CHANNEL.value
        if scanned and not channel.values.get("AI_THRMCPL_CJC_CHAN"):
            raise DaqmxError(
                DAQmxErrors.CJC_CHAN_NAME_MUST_BE_SET_WHEN_CJC_SRC_IS_SCANNABLE_CHAN,
                f"The channel of the cold junction of {channel.name!r} must be set, because a channel is its "
                "source.",
            )
        built_in = channel.values.get("AI_THRMCPL_CJC_SRC") == CJCSource.BUILT_IN.value
        if built_in and not channel.product.ai_cjc:
            raise DaqmxError(
                DAQmxErrors.BUILT_IN_CJC_SRC_NOT_SUPPORTED,
                f"Built-in cold-junction compensation is not supported by {channel.device.name}, a "
                f"{channel.product.name}: use a constant value or a channel.",
            )
