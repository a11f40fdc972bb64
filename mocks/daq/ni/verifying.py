"""Checks of the combination of a task's settings, as the driver makes them when it verifies a task."""

from __future__ import annotations

from collections.abc import Container

from nidaqmx.constants import CJCSource

from .errors import DaqmxError, DAQmxErrors, DAQmxWarnings
from .tasks import Task

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
    if task.has_start_trigger and not task.timed and kind not in ("co", "ci"):
        raise DaqmxError(
            DAQmxErrors.TRIG_WHEN_ON_DEMAND_SAMP_TIMING,
            f"Task {task.name!r} has a trigger, but its timing is on demand: set a sample clock.",
        )
    if task.timed and kind in ("ai", "ao"):
        _refuse_rate(task)
        for channel in task.channels:
            _ = channel.full_scale
    _refuse_interval(task)
    if kind == "ai":
        _refuse_cold_junction(task)
    if task.total is not None and task.timed and kind not in ("ci", "co") and task.samples_asked < 2:
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            "Requested value is not a supported value for this property: "
            "a finite task needs at least 2 samples per channel.",
        )


def _refuse_rate(task: Task) -> None:
    """Refuse a rate that the converters cannot do, and warn of one at which their inputs do not settle."""
    product, channels = task.device.product, len(task.channels)
    if task.kind == "ao":
        most = settled = product.ao_rate_hz
        if not most:
            raise DaqmxError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                "Requested value is not a supported value for this property: sample timing type of "
                f"{task.device.name}: the outputs of a {product.name} have no sample clock.",
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


def refuse_unscaled(task: Task, wired: Container[str]) -> None:
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
            raise DaqmxError(
                DAQmxErrors.ATTR_NOT_SUPPORTED,
                f"Specified property is not supported: the twin does not turn volts at {channel.name!r} into "
                f"what a channel of the kind {usage} shows. Leave its input undriven, or measure voltage.",
            )


def _refuse_cold_junction(task: Task) -> None:
    for channel in task.channels:
        built_in = channel.values.get("AI_THRMCPL_CJC_SRC") == CJCSource.BUILT_IN.value
        if built_in and not channel.product.ai_cjc:
            raise DaqmxError(
                DAQmxErrors.BUILT_IN_CJC_SRC_NOT_SUPPORTED,
                f"Built-in cold-junction compensation is not supported by {channel.device.name}, a "
                f"{channel.product.name}: use a constant value or a channel.",
            )
