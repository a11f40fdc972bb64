"""The real nidaqmx package, connected to a wire in this process."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType

from haploop.base.arrays import FloatArray
from haploop.base.clock import VirtualClock
from haploop.nidaqmx_twin import NiServer
from haploop.nidaqmx_twin.nodes import Source

CONTINUOUS, FINITE = AcquisitionType.CONTINUOUS, AcquisitionType.FINITE
EXPORT = """
[DAQmx]
MajorVersion = 21

[DAQmxScale double]
Lin.Slope = 2
Lin.YIntercept = 1
ScaleType = Linear

[DAQmxScale same]
Poly.ForwardCoeff = 0, 1
Poly.ReverseCoeff = 0, 1
ScaleType = Polynomial

[DAQmxDevice Sim]
ProductType = PCIe-6363
DevSerialNum = 0x0
DevIsSimulated = 1
ProductNum = 0x7435C4C4

[DAQmxDevice Card]
ProductType = PCIe-6363
DevSerialNum = 0x1A2B
DevIsSimulated = 0

[DAQmxDevice Old]
ProductType = PCI-6034E
DevIsSimulated = 1

[DAQmxDevice Bridge]
ProductType = PXIe-9999
DevIsSimulated = 1

[DAQmxCDAQChassis Frame]
ProductType = cDAQ-9189
DevIsSimulated = 1

[DAQmxCDAQModule FrameMod1]
ProductType = NI 9215
CompactDAQ.ChassisDevName = Frame
CompactDAQ.SlotNum = 1

[DAQmxCDAQModule FrameMod2]
ProductType = NI 9205
CompactDAQ.ChassisDevName = Frame
CompactDAQ.SlotNum = 2

[DAQmxCDAQModule StrayMod1]
ProductType = NI 9401
CompactDAQ.ChassisDevName = Stray
CompactDAQ.SlotNum = 1
"""
"""As NI MAX writes it: products that are simulated, and some that are not."""


@contextmanager
def connected(server: NiServer) -> Iterator[nidaqmx.GrpcSessionOptions]:
    """Options for tasks and systems on `server`."""
    options = [("grpc.max_receive_message_length", -1), ("grpc.enable_http_proxy", 0)]
    with grpc.insecure_channel(server.address, options=options) as channel:
        yield nidaqmx.GrpcSessionOptions(channel, "")


@contextmanager
def fails(code: int, kind: type[nidaqmx.DaqError] = nidaqmx.DaqError) -> Iterator[pytest.ExceptionInfo]:
    """The body ends with an error of this number."""
    with pytest.raises(kind) as caught:
        yield caught
    assert caught.value.error_code == code


def code(of: Callable[[], Any]) -> int | None:
    """NI's error code of what is refused, None of what is not."""
    try:
        of()
    except nidaqmx.DaqError as error:
        return int(error.error_code)
    return None


def clocked(task: nidaqmx.Task, channel: str, *clock: Any, **words: Any) -> Any:
    """Add a channel of volts or of lines to the task, time it by the sample clock, and return it."""
    kind = "di" if "/port" in channel else "ao_voltage" if "/ao" in channel else "ai_voltage"
    made = getattr(getattr(task, f"{kind[:2]}_channels"), f"add_{kind}_chan")(channel)
    task.timing.cfg_samp_clk_timing(*clock, **words)
    return made


Make = Callable[[nidaqmx.Task], Any]


def on(add: str, channel: str, *timing: Any, then: str = "start", **words: Any) -> Make:
    """A task of a channel, which is timed by what of nidaqmx `timing` names, or by a sample clock's rate and
    source, and is started then.
    """

    def make(task: nidaqmx.Task) -> None:
        getattr(getattr(task, f"{add[:2]}_channels"), f"add_{add}")(channel, **words)
        if timing and isinstance(timing[0], str):
            getattr(task.timing, timing[0])(*timing[1:])
        elif timing:
            task.timing.cfg_samp_clk_timing(*timing, samps_per_chan=10)
        getattr(task, then)()

    make.__name__ = " ".join(map(str, (add, channel, *timing, *words.values())))  # which pytest shows
    return make


class Bench:
    """A plant of two nodes: "tone" is a sine of 10 Hz and 3 V, "loop" is what drives "out"."""

    def __init__(self) -> None:
        self.clock = VirtualClock(start=100.0)
        self._source: Source | None = None
        self._steps: list[tuple[float, float]] = [(-np.inf, 0.0)]

    def plays(self, device: str) -> None:
        """No play of this plant is ever cut off."""

    def drive(self, node: str, source: Source) -> None:
        assert node == "out"
        self._source = source

    def read(self, nodes: Sequence[str], times: FloatArray) -> FloatArray:
        return np.array([self._read(node, own) for node, own in zip(nodes, times, strict=True)])

    def _read(self, node: str, times: FloatArray) -> FloatArray:
        assert len(times) == 0 or times[-1] <= self.clock.now() + 1e-9, "nobody can read the future"
        if node == "tone":
            return np.asarray(3 * np.sin(2 * np.pi * 10 * times))
        assert node == "loop" and self._source is not None
        for run in self._source.take(float(times[-1])):
            self._steps += zip(run.times, run.values, strict=True)
        starts = np.array([s for s, _ in self._steps])
        values = np.array([v for _, v in self._steps])
        # A step on the very edge of a sample has happened.
        return np.asarray(values[np.searchsorted(starts, times + 1e-9, side="right") - 1])
