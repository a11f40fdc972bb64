"""Checks of a counter task's settings and of how a task is timed, as the driver makes them."""

from __future__ import annotations

from nidaqmx.constants import Edge, SampleTimingType, UsageTypeCI

from .channel import Channel, counter_timebase
from .errors import DaqmxError, DAQmxErrors, unsupported
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
