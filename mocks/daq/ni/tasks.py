"""A task and its channels: their configuration and progress."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Literal

import numpy as np
from nidaqmx.constants import AcquisitionType, SampleTimingType, TriggerType

from ....instruments.arrays import FloatArray
from ..converter import code_width
from ..products import Product, convert_interval, input_range
from .devices import NiDevice
from .errors import DaqmxError, DAQmxErrors
from .scales import Scale
from .terminals import Timebase
from .watchdog import Watchdog

__all__ = ["Channel", "Chunk", "Kind", "State", "Task"]

Kind = Literal["ai", "ao", "di", "do", "ci", "co"]

_TIMEBASE_HZ = {"E Series": 20e6, "M Series": 80e6, "X Series": 100e6, "Digital I/O": 100e6, "C Series": 80e6}
"""Timebase of the sample clocks, by family (X Series from its manual, others estimates; docs/hardware.md,
"PCIe-6321 (X Series)")."""


class State(IntEnum):
    """State of a task; each state includes the ones before it."""

    UNVERIFIED = 0
    RESERVED = 1
    COMMITTED = 2
    RUNNING = 3


@dataclass
class Channel:
    """One virtual channel: a converter's terminal, or a group of digital lines."""

    name: str
    kind: Kind
    device: NiDevice
    physical: tuple[str, ...]
    """Names without the device: ("ai0",), or lines in the order given ("port0/line0", ...), a whole port from
    its highest line down. It is also the order of a digital waveform's columns."""
    values: dict[str, Any] = field(default_factory=dict)
    """Properties that were set, by attribute name."""
    ports: bool = False
    """True for a digital channel of whole ports."""
    scale: Scale | None = None
    """Custom scale between volts and the program's units."""

    @property
    def product(self) -> Product:
        """Product of the channel's device."""
        return self.device.product

    @property
    def low(self) -> float:
        """Lowest value that the program requested."""
        return float(self.values.get(f"{self.kind.upper()}_MIN", -10.0))

    @property
    def high(self) -> float:
        """Highest value that the program requested."""
        return float(self.values.get(f"{self.kind.upper()}_MAX", 10.0))

    @property
    def volts(self) -> FloatArray:
        """Limits that the program requested, as voltages at the terminal: (2,) V, rising."""
        limits = np.array([self.low, self.high])
        return limits if self.scale is None else np.sort(self.scale.to_volts(limits))

    @property
    def full_scale(self) -> float:
        """Range of the converter, as +- full scale (V)."""
        if self.kind == "ao":
            wanted = float(np.abs(self.volts).max())
            low = 0.0 if self.product.ao_unipolar else -self.product.ao_range
            if wanted > self.product.ao_range * (1 + 1e-9) or self.volts[0] < low * (1 + 1e-9):
                raise DaqmxError(
                    DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                    f"Requested value is not a supported value for this property: {self.name} of "
                    f"{self.product.name} puts out {low:g} to {self.product.ao_range:g} V, not "
                    f"{self.volts[0]:g} to {self.volts[1]:g} V.",
                )
            return self.product.ao_range
        forced = self.values.get("AI_RNG_HIGH")
        wanted = forced if forced is not None else float(np.abs(self.volts).max())
        if self.values.get("AI_MEAS_TYPE_NAME", "VOLTAGE") != "VOLTAGE":
            wanted = self.product.ai_ranges[0]
        found = input_range(self.product, float(wanted))
        if found is None:
            raise DaqmxError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                f"Requested value is not a supported value for this property: {self.name} of "
                f"{self.product.name} has no range of +-{wanted:g} V, only "
                f"+-{', +-'.join(f'{r:g}' for r in self.product.ai_ranges)} V.",
            )
        return found

    @property
    def width(self) -> float:
        """Volts per code."""
        if self.kind == "ao":
            return self.product.ao_range / 2.0 ** (self.product.ao_bits - 1)
        return float(code_width(self.product, np.array(self.full_scale)))


@dataclass
class Chunk:
    """Acquired samples that are still kept: (channels, samples) from index `first`."""

    first: int
    samples: Any


class Task:
    """One task: its channels, settings and progress. Guarded by the system's lock."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.channels: list[Channel] = []
        self.settings: dict[tuple[str, str], Any] = {}
        self.state = State.UNVERIFIED
        self.state_before = State.UNVERIFIED
        """State before the start, to which a stop returns."""
        self.changed = False
        """True when a property was set since the task was reserved."""
        self.auto_started = False
        self.clock = Timebase(1000.0)
        self.offset = 0
        """Number of clock edges before this task joined the clock."""
        self.waits_for: set[str] = set()
        """Signals of other tasks for which it waits."""
        self.shares: str | None = None
        """Terminal of the sample clock that it shares with another task."""
        self.starts = 0
        self.read_position = 0
        self.on_demand = 0
        """Samples taken by software since the task was last stopped."""
        self.chunks: deque[Chunk] = deque()
        self.made = 0
        self.noise: dict[str, np.random.Generator] = {}
        self.phase = 0
        self.overloaded: list[str] = []
        self.buffer: FloatArray = np.zeros((0, 0))
        """Samples still to be played, (rows, samples), one row for each terminal."""
        self.written = 0
        """Samples per channel written since the start, or since the buffer was begun."""
        self.first_write = 0
        """Samples per channel of the buffer's first write: the buffer's size unless the program set one."""
        self.dropped = 0
        """Number of played samples removed from the buffer's beginning."""
        self.failure: DaqmxError | None = None
        self.watchdog: Watchdog | None = None
        """Set for a watchdog timer task, which has no channels."""

    @property
    def kind(self) -> Kind:
        """Subsystem that the task uses. Raises DaqmxError without channels."""
        if not self.channels:
            raise DaqmxError(
                DAQmxErrors.CAN_NOT_PERFORM_OP_WHEN_NO_CHANS_IN_TASK,
                f"Operation cannot be performed, because task {self.name!r} contains no channels.",
            )
        return self.channels[0].kind

    @property
    def device(self) -> NiDevice:
        """Device of the first channel. Raises DaqmxError without channels."""
        _ = self.kind
        return self.channels[0].device

    @property
    def devices(self) -> list[NiDevice]:
        """Devices of all channels."""
        return list({channel.device.name: channel.device for channel in self.channels}.values())

    @property
    def is_input(self) -> bool:
        """True for a task that acquires."""
        return self.kind in ("ai", "di", "ci")

    @property
    def running(self) -> bool:
        """True from the start to the stop."""
        return self.state is State.RUNNING

    def setting(self, kind: str, name: str, default: Any = None) -> Any:
        """Return a property of the task that a program has set, or `default`."""
        return self.settings.get((kind, name), default)

    @property
    def timed(self) -> bool:
        """True when a sample clock, rather than the program, times the samples."""
        return bool(
            self.setting("Timing", "SAMP_TIMING_TYPE", SampleTimingType.ON_DEMAND.value)
            != SampleTimingType.ON_DEMAND.value
        )

    @property
    def rate_hz(self) -> float:
        """Actual sample rate: the timebase divided by an integer."""
        divisor = self.setting("Timing", "SAMP_CLK_TIMEBASE_DIV")
        asked = float(self.setting("Timing", "SAMP_CLK_RATE", 1000.0))
        if str(self.setting("Timing", "SAMP_CLK_SRC", "")).endswith("ai/SampleClock"):
            return asked  # The card does not divide a clock that comes from another task.
        timebase = self.timebase_hz
        return timebase / (divisor or max(1, round(timebase / asked)))

    @property
    def timebase_hz(self) -> float:
        """Frequency of the sample clock's timebase."""
        return _TIMEBASE_HZ.get(self.device.product.family, 100e6)

    @property
    def samples_asked(self) -> int:
        """Configured number of samples per channel."""
        return int(self.setting("Timing", "SAMP_QUANT_SAMP_PER_CHAN", 1000))

    @property
    def total(self) -> int | None:
        """Samples per channel of a finite task; None for a task that runs until it is stopped."""
        mode = self.setting("Timing", "SAMP_QUANT_SAMP_MODE", AcquisitionType.CONTINUOUS.value)
        if mode != AcquisitionType.FINITE.value or self.setting("Trig", "START_TRIG_RETRIGGERABLE", False):
            return None
        return self.samples_asked

    @property
    def has_start_trigger(self) -> bool:
        """True when the task has a start trigger."""
        return bool(self.setting("Trig", "START_TRIG_TYPE", TriggerType.NONE.value) != TriggerType.NONE.value)

    @property
    def interval(self) -> float:
        """Interval between the conversions of neighbouring channels (s)."""
        rate = self.setting("Timing", "AI_CONV_RATE")
        product = self.device.product
        if rate and not product.ai_simultaneous:
            return 1.0 / float(rate)
        same = [c for c in self.channels if c.device == self.device]
        return convert_interval(product, self.rate_hz if self.timed else 1.0, len(same))

    def delay(self, index: int) -> float:
        """Return the delay of channel `index`'s conversion after the clock edge (s), in its card's order."""
        device = self.channels[index].device
        before = sum(channel.device == device for channel in self.channels[:index])
        return 0.0 if device.product.ai_simultaneous else before * self.interval

    @property
    def skew(self) -> float:
        """Delay of the last channel's conversion after the clock edge (s)."""
        if self.kind != "ai":
            return 0.0
        return max(self.delay(i) for i in range(len(self.channels)))

    @property
    def buffer_size(self) -> int:
        """Size of the host's buffer (samples per channel): as the program set it, or NI's default."""
        kind = "INPUT_BUF_SIZE" if self.is_input else "OUTPUT_BUF_SIZE"
        asked = self.setting("Buffer", kind)
        if asked is not None:
            return int(asked)
        if not self.is_input:
            return self.first_write
        if self.total is not None:
            return self.total
        rate = self.rate_hz
        usual = 1_000 if rate <= 100 else 10_000 if rate <= 10_000 else 100_000 if rate <= 1e6 else 1_000_000
        return max(usual, self.samples_asked)

    def count(self, now: float) -> int:
        """Return the samples per channel completed at `now` (s): acquired or put out."""
        if not self.timed:
            return self.on_demand
        count = max(0, self.clock.edges(now - self.skew) - self.offset)
        return count if self.total is None else min(count, self.total)

    def ready(self, samples: int) -> float | None:
        """Return the time when `samples` samples per channel are complete (s); None if never or unknown."""
        if self.total is not None and samples > self.total:
            return None
        edge = self.clock.time(self.offset + samples - 1)
        return None if edge is None else edge + self.skew

    def done(self, now: float) -> bool:
        """Return True when the task has no more samples to acquire or put out."""
        if not self.running or not self.timed:
            return True
        if self.failure is not None:
            return True
        count = self.count(now)
        if self.total is not None and count >= self.total:
            return True
        return bool(self.clock.total is not None and self.clock.edges(now - self.skew) >= self.clock.total)

    def verify(self) -> None:
        """Check the combination of the settings. Raises DaqmxError."""
        kind = self.kind
        if kind == "ao":
            for channel in self.channels:
                _ = channel.full_scale
        if self.has_start_trigger and not self.timed and kind not in ("co", "ci"):
            raise DaqmxError(
                DAQmxErrors.TRIG_WHEN_ON_DEMAND_SAMP_TIMING,
                f"Task {self.name!r} has a trigger, but its timing is on demand: set a sample clock.",
            )
        if self.timed and kind in ("ai", "ao"):
            product, channels = self.device.product, len(self.channels)
            if kind == "ao":
                most = product.ao_rate_hz
            elif product.ai_simultaneous or channels == 1:
                most = product.ai_rate_single_hz
            else:
                most = product.ai_rate_hz / channels
            if self.rate_hz > most * (1 + 1e-9):
                raise DaqmxError(
                    DAQmxErrors.SAMP_RATE_TOO_HIGH,
                    f"Sample rate {self.rate_hz:g} Hz is above what {self.device.name} "
                    f"({product.name}) can do with {channels} channels: {most:g} Hz.",
                )
            for channel in self.channels:
                _ = channel.full_scale
        if self.total is not None and self.timed and self.samples_asked < 2:
            raise DaqmxError(
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
                "Requested value is not a supported value for this property: "
                "a finite task needs at least 2 samples per channel.",
            )
