"""Checks of how a task is timed, and of what is in it twice."""

from __future__ import annotations

from nidaqmx.constants import SampleTimingType

from .errors import DaqmxError, DAQmxErrors
from .tasks import Task

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
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            f"Requested value is not a supported value for this property: sample timing type {asked.name} of "
            f"task {task.name!r}; a {product.name} has {', '.join(sorted(one.name for one in own))}.",
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
