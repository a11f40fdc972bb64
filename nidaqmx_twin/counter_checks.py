"""Checks of a counter task's settings, as the driver makes them when it verifies a task."""

from __future__ import annotations

from nidaqmx.constants import Edge, UsageTypeCI

from .channel import Channel, counter_timebase
from .errors import DaqmxError, DAQmxErrors
from .tasks import Task

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
            raise DaqmxError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                "Requested value is not a supported value for this property: sample timing type of "
                f"{task.name!r}: a {product.name} measures times by implicit timing.",
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
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            "Requested value is not a supported value for this property: CI_COUNT_EDGES_ACTIVE_EDGE of "
            f"{channel.name!r}, a {product.name}, is falling only.",
        )
    steps = [values.get(name, 1) for name in _STEPS]
    if not all(steps):
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            "Requested value is not a supported value for this property: the pulses per revolution, or the "
            f"distance per pulse, of {channel.name!r} are not 0.",
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
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            f"Requested value is not a supported value for this property: pulses of {channel.name!r} need a "
            "frequency or times above 0, and a duty cycle between 0 and 1.",
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
