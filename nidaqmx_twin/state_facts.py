"""Properties of tasks and channels that their state decides."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from nidaqmx import constants as c

from .channel import Channel
from .errors import DaqmxError, DAQmxErrors
from .reading import available
from .system import NiSystem
from .tasks import State, Task
from .verifying import verify
from .writing import space

_CHANNEL_TYPE = {
    "ai": c.ChannelType.ANALOG_INPUT,
    "ao": c.ChannelType.ANALOG_OUTPUT,
    "di": c.ChannelType.DIGITAL_INPUT,
    "do": c.ChannelType.DIGITAL_OUTPUT,
    "ci": c.ChannelType.COUNTER_INPUT,
    "co": c.ChannelType.COUNTER_OUTPUT,
}


def _limit(sign: int) -> Callable[[Channel], float]:
    def limit(channel: Channel) -> float:
        name, missing = (
            ("AI_MAX", DAQmxErrors.AI_MAX_NOT_SPECIFIED)
            if sign > 0
            else ("AI_MIN", DAQmxErrors.AI_MIN_NOT_SPECIFIED)
        )
        if name not in channel.values and "AI_SOUND_PRESSURE_MAX_SOUND_PRESSURE_LVL" not in channel.values:
            raise DaqmxError(missing, f"{name} of {channel.name!r} was reset and has not been set since.")
        kind = channel.values.get("AI_MEAS_TYPE_NAME")
        by_range = kind == "SOUND_PRESSURE_MICROPHONE" or (kind == "TEMPERATURE_RTD" and sign > 0)
        if (kind != "VOLTAGE" or channel.values.get("AI_IS_TEDS")) and not by_range:
            return channel.high if sign > 0 else channel.low
        # The driver reports the limits of the range that it chose, which contains the requested one.
        ends = np.array([-channel.full_scale, channel.full_scale])
        if channel.scale is not None:
            ends = channel.scale.to_units(ends)
        return float(ends.max() if sign > 0 else ends.min())

    return limit


def _ratio(channel: Channel) -> float:
    """Volts per unit in which a range is told: a bridge's is a ratio to its excitation."""
    bridged = channel.values.get("AI_MEAS_TYPE_NAME", "").endswith("BRIDGE")
    return float(channel.values.get("AI_EXCIT_VAL") or 1.0) if bridged else 1.0


CHANNEL_STATE: dict[str, Callable[[Channel], Any]] = {
    "CHAN_TYPE": lambda ch: _CHANNEL_TYPE[ch.kind].value,
    "PHYSICAL_CHAN_NAME": lambda ch: ", ".join(
        f"{ch.device.name}/{p}"
        for p in (dict.fromkeys(p.partition("/")[0] for p in ch.physical) if ch.ports else ch.physical)
    ),
    "AI_MAX": _limit(1),
    "AI_MIN": _limit(-1),
    "AI_RNG_HIGH": lambda ch: ch.full_scale / _ratio(ch),
    "AI_RNG_LOW": lambda ch: -ch.full_scale / _ratio(ch),
    "AI_RESOLUTION": lambda ch: float(ch.product.ai_bits),
    "AI_RAW_SAMP_SIZE": lambda ch: 16 if ch.product.ai_bits <= 16 else 32,
    "AI_EXCIT_ACTUAL_VAL": lambda ch: ch.values.get("AI_EXCIT_VAL", 0.0),
    "PWR_OUTPUT_STATE": lambda ch: (
        (
            c.PowerOutputState.CONSTANT_VOLTAGE
            if ch.values.get("PWR_OUTPUT_ENABLE")
            else c.PowerOutputState.OUTPUT_DISABLED
        ).value
    ),
    "PWR_VOLTAGE_DEV_SCALING_COEFF": lambda ch: [0.0, 1 / 4096],
    "PWR_CURRENT_DEV_SCALING_COEFF": lambda ch: [0.0, 1 / 8192],
    "AI_INPUT_SRC": lambda ch: ch.values.get("AI_INPUT_SRC", "_external_channel"),
    "AI_DEV_SCALING_COEFF": lambda ch: [0.0, ch.width],
    "AO_MAX": lambda ch: ch.high,
    "AO_MIN": lambda ch: ch.low,
    "AO_DAC_RNG_HIGH": lambda ch: ch.full_scale,
    "AO_DAC_RNG_LOW": lambda ch: -ch.full_scale,
    "AO_RESOLUTION": lambda ch: float(ch.product.ao_bits),
    "AO_DEV_SCALING_COEFF": lambda ch: [0.0, 1 / ch.width],
    "DI_NUM_LINES": lambda ch: len(ch.physical),
    "DO_NUM_LINES": lambda ch: len(ch.physical),
}


def _samples_asked(system: NiSystem, task: Task) -> int:
    if task.timed and task.total is not None:
        verify(task)
    return task.samples_asked


def _clock_source(system: NiSystem, task: Task) -> str:
    source = task.setting("Timing", "SAMP_CLK_SRC", "")
    device = task.device
    if source and device.product.family == "Digital I/O":
        return str(source)  # These cards report it as it was written (NI's own tests of a 6535).
    return (
        system.inventory.written(device, source)
        if source
        else f"/{device.name}/{task.kind}/SampleClockTimebase"
    )


def _max_rate(task: Task) -> float:
    product, channels = task.device.product, len(task.channels)
    if task.kind == "ao":
        return product.ao_rate_hz
    if channels == 1 or product.ai_simultaneous:
        return product.ai_rate_single_hz
    return product.ai_rate_hz / channels


def _conversion_rate(system: NiSystem, task: Task) -> float:
    asked = task.setting("Timing", "AI_CONV_RATE")
    if asked:
        return float(asked)
    interval = task.interval
    return 1 / interval if interval else task.rate_hz


def _conversion_divisor(system: NiSystem, task: Task) -> int:
    asked = task.setting("Timing", "AI_CONV_TIMEBASE_DIV")
    if asked:
        return int(asked)
    if task.device.product.family == "C Series":
        # A real NI 9205 reports padding for a single channel too, and its divisor is one larger.
        return int(task.timebase_hz * (1 / task.device.product.ai_rate_hz + 10e-6) + 0.5) + 1
    return round(task.timebase_hz * task.interval)


def _clock_name(source: str) -> Callable[[NiSystem, Task], str]:
    return lambda _s, task: f"/{task.device.chassis or task.device.name}/{task.kind}/{source}"


def _start_terminal(system: NiSystem, task: Task) -> str:
    """Terminal of the start trigger. A chassis has one for each timing engine, known once it is reserved.

    (Issue 162 of ni/nidaqmx-python.)
    """
    device = task.device
    if device.chassis is None:
        return f"/{device.name}/{task.kind}/StartTrigger"
    if task.kind == "ai" and task.state < State.RESERVED:
        raise DaqmxError(
            DAQmxErrors.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING,
            f"Specified property cannot be read before the task {task.name!r} is reserved: it then gets "
            f"one of {device.chassis}'s timing engines. Call task.control(TaskMode.TASK_RESERVE) first.",
        )
    return f"/{device.chassis}/{task.kind}/StartTrigger"


def _line_bytes(_system: NiSystem, task: Task) -> int:
    return max(len(channel.physical) for channel in task.channels)


def _raw_width(_system: NiSystem, task: Task) -> int:
    if task.kind in ("ci", "co"):
        return 4
    if task.kind in ("ai", "ao"):
        return (
            2
            if (task.device.product.ai_bits if task.kind == "ai" else task.device.product.ao_bits) <= 16
            else 4
        )
    widest = max(task.device.product.ports)
    return 4 if widest > 16 else 1


def _start_time(system: NiSystem, task: Task) -> datetime:
    return system.epoch + timedelta(seconds=task.clock.start or 0.0)


TASK_STATE: dict[str, dict[str, Callable[[NiSystem, Task], Any]]] = {
    "Task": {
        "NAME": lambda s, t: t.name,
        "CHANNELS": lambda s, t: ", ".join(channel.name for channel in t.channels),
        "DEVICES": lambda s, t: ", ".join(d.name for d in t.devices) if t.channels else "",
        "NUM_CHANS": lambda s, t: len(t.channels),
        "NUM_DEVICES": lambda s, t: len(t.devices) if t.channels else 0,
        "COMPLETE": lambda s, t: t.done(s.clock.now()),
    },
    "Timing": {
        "SAMP_CLK_RATE": lambda s, t: t.rate_hz,
        "SAMP_CLK_MAX_RATE": lambda s, t: _max_rate(t),
        "SAMP_CLK_TIMEBASE_RATE": lambda s, t: t.timebase_hz,
        "SAMP_CLK_TIMEBASE_DIV": lambda s, t: round(t.timebase_hz / t.rate_hz),
        "SAMP_CLK_TIMEBASE_SRC": lambda s, t: f"/{t.device.name}/{t.timebase_hz / 1e6:g}MHzTimebase",
        "SAMP_CLK_SRC": _clock_source,
        "SAMP_CLK_TERM": _clock_name("SampleClock"),
        "SAMP_CLK_TIMEBASE_TERM": _clock_name("SampleClockTimebase"),
        "SAMP_QUANT_SAMP_PER_CHAN": _samples_asked,
        "AI_CONV_RATE": _conversion_rate,
        "AI_CONV_MAX_RATE": lambda s, t: t.device.product.ai_rate_hz,
        "AI_CONV_TIMEBASE_DIV": _conversion_divisor,
        "AI_CONV_SRC": _clock_name("ConvertClockTimebase"),
        "FIRST_SAMP_TIMESTAMP_VAL": _start_time,
    },
    "Trig": {
        "START_TRIG_TERM": _start_terminal,
        "REF_TRIG_TERM": _clock_name("ReferenceTrigger"),
        "PAUSE_TRIG_TERM": _clock_name("PauseTrigger"),
        "START_TRIG_TIMESTAMP_VAL": _start_time,
        "REF_TRIG_TIMESTAMP_VAL": _start_time,
    },
    "Read": {
        "CHANNELS_TO_READ": lambda s, t: t.setting(
            "Read", "CHANNELS_TO_READ", ", ".join(channel.name for channel in t.channels)
        ),
        "NUM_CHANS": lambda s, t: len(t.channels),
        "DEFAULT_SAMPS_TO_READ": lambda s, t: (
            t.samples_asked
            if t.total is not None and t.timed and not t.setting("Read", "READ_ALL_AVAIL_SAMP", False)
            else available(s, t)
        ),
        "AVAIL_SAMP_PER_CHAN": available,
        "CURR_READ_POS": lambda s, t: t.read_position,
        "TOTAL_SAMP_PER_CHAN_ACQUIRED": lambda s, t: t.count(s.clock.now()),
        "RAW_DATA_WIDTH": _raw_width,
        "DIGITAL_LINES_BYTES_PER_CHAN": _line_bytes,
        "OVERLOADED_CHANS_EXIST": lambda s, t: bool(t.overloaded),
        "OVERLOADED_CHANS": lambda s, t: ", ".join(dict.fromkeys(t.overloaded)),
    },
    "Write": {
        "NUM_CHANS": lambda s, t: len(t.channels),
        "CURR_WRITE_POS": lambda s, t: t.written,
        "TOTAL_SAMP_PER_CHAN_GENERATED": lambda s, t: t.count(s.clock.now()),
        "SPACE_AVAIL": space,
        "RAW_DATA_WIDTH": _raw_width,
        "DIGITAL_LINES_BYTES_PER_CHAN": _line_bytes,
    },
    "Buffer": {
        "INPUT_BUF_SIZE": lambda s, t: t.buffer_size if t.timed else 0,
        "OUTPUT_BUF_SIZE": lambda s, t: t.buffer_size,
        "INPUT_ONBRD_BUF_SIZE": lambda s, t: t.setting(
            "Buffer", "INPUT_ONBRD_BUF_SIZE", t.device.product.ai_fifo
        ),
        "OUTPUT_ONBRD_BUF_SIZE": lambda s, t: t.setting(
            "Buffer", "OUTPUT_ONBRD_BUF_SIZE", t.device.product.ao_fifo
        ),
    },
}
