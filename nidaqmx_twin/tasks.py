"""A task: its configuration and progress."""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from nidaqmx.constants import AcquisitionType, DigitalWidthUnits, SampleTimingType, TriggerType

from ..base.arrays import FloatArray
from .channel import Channel, Kind
from .counting import Meter
from .devices import NiDevice
from .errors import DaqmxError, DAQmxErrors
from .products import convert_interval
from .pulses import PulseTrain, Train
from .terminals import Edges, Timebase
from .watchdog import Watchdog


class State(IntEnum):
    """State of a task; each state includes the ones before it."""

    UNVERIFIED = 0
    RESERVED = 1
    COMMITTED = 2
    RUNNING = 3


def refuse_rate(name: str, value: Any) -> None:
    """Raise DaqmxError for a rate that is not above 0; `name` is the property that is set."""
    if name.endswith("_RATE") and value is not None and not 0 < float(value) < float("inf"):
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            f"Requested value is not a supported value for this property.\n\nProperty: {name}\n"
            f"Requested Value: {float(value):g}\nValue Must Be Greater Than: 0.0",
        )


def session_of(name: str, process: str) -> str:
    """Name by which a task of a process is asked for: tasks of two processes may have the same name."""
    return f"{name}@{process}" if process else name


@dataclass
class Chunk:
    """Acquired samples that are still kept: (channels, samples) from index `first`."""

    first: int
    samples: Any


class Task:
    """One task: its channels, settings and progress. Guarded by the system's lock."""

    warning = 0
    """Code of the driver's warning when it was verified; 0 for none."""
    told = 0
    """Number of the start at which its program was told what has no effect."""
    every = heard = 0
    """Samples between the events that its program has registered, 0 without any; its registrations."""
    logged = 0
    """Samples per channel that are in its log file."""
    log_path: object = None
    folder = ""
    """Folder of the program that named its log file; empty for the server's own."""
    edges: Edges | None = None
    """Edges that time its samples, where a signal does it."""
    ticks: Train | None = None
    """Its sample clock, as it stands at a terminal."""
    trigger: Edges | None = None
    """Edges of the signal at its start trigger, until the first has come."""

    def __init__(self, name: str, process: str = "") -> None:
        """`process` is the program that made it, where its name is unique; empty for a server's client."""
        self.name, self.process = name, process
        self.session = session_of(name, process)
        """Name by which requests and answers call it."""
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
        self.overloaded: list[str] = []
        self.buffer: FloatArray = np.zeros((0, 0))
        """Samples still to be played, (rows, samples), one row for each terminal."""
        self.written = 0
        """Samples per channel written since the start, or since the buffer was begun."""
        self.first_write = 0
        """Samples per channel of the buffer's first write: the buffer's size unless the program set one."""
        self.dropped = 0
        """Number of played samples removed from the buffer's beginning."""
        self.meters: list[Meter] = []
        """Measurements of its counter inputs since it was armed."""
        self.trains: list[PulseTrain] = []
        """Pulses of its counter outputs since it was started."""
        self.pulses: tuple[FloatArray, FloatArray] | None = None
        """High and low times (channels, pulses) s that a program has written to counter outputs."""
        self.reference: int | None = None
        """Index of the sample at the reference trigger, once it has come."""
        self.failure: DaqmxError | None = None
        self.watchdog: Watchdog | None = None
        """Set for a watchdog timer task, which has no channels."""

    def begin(self, before: State, shares: str | None, auto: bool) -> None:
        """Run, with nothing sampled yet; a stop returns to `before`, `shares` is another's sample clock."""
        self.state_before, self.state, self.auto_started = before, State.RUNNING, auto
        self.failure = None
        self.starts += 1
        self.read_position = self.made = 0
        self.chunks.clear()
        self.overloaded.clear()
        self.clock, self.offset, self.shares = Timebase(self.rate_hz), 0, shares
        self.meters, self.trains, self.reference = [], [], None
        self.edges = self.trigger = self.ticks = None
        self.logged, self.log_path = 0, None

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
    def detects_changes(self) -> bool:
        """True when changes of digital lines time the samples."""
        return bool(self.setting("Timing", "SAMP_TIMING_TYPE") == SampleTimingType.CHANGE_DETECTION.value)

    @property
    def on_own_clock(self) -> bool:
        """True when no source of a sample clock is named but the device's own."""
        return str(self.setting("Timing", "SAMP_CLK_SRC", "")).lower() in ("", "onboardclock")

    @property
    def implicit(self) -> bool:
        """True when the signal itself times the samples of a counter."""
        return bool(self.setting("Timing", "SAMP_TIMING_TYPE") == SampleTimingType.IMPLICIT.value)

    @property
    def pretrigger(self) -> int | None:
        """Samples to be kept from before a reference trigger; None without one."""
        if self.setting("Trig", "REF_TRIG_TYPE", TriggerType.NONE.value) == TriggerType.NONE.value:
            return None
        return int(self.setting("Trig", "REF_TRIG_PRETRIG_SAMPLES", 2))

    @property
    def rate_hz(self) -> float:
        """Actual sample rate: the timebase divided by an integer.

        For analog inputs the divisor is rounded down, for other channels to the nearest integer (NI knowledge
        base kA00Z000000P83OSAS); delta-sigma converters take the next higher rate of their own.
        """
        if self.channels and self.kind == "co":
            high, low = self.channels[0].pulse
            return 1 / (high + low)
        if self.channels and self.kind == "ai" and self.device.product.delta_sigma:
            return self.device.product.sample_rate(float(self.setting("Timing", "SAMP_CLK_RATE", 1000.0)))
        divisor = self.setting("Timing", "SAMP_CLK_TIMEBASE_DIV")
        asked = float(self.setting("Timing", "SAMP_CLK_RATE", 1000.0))
        if str(self.setting("Timing", "SAMP_CLK_SRC", "")).endswith("ai/SampleClock"):
            return asked  # The card does not divide a clock that comes from another task.
        timebase = self.timebase_hz
        down = bool(self.channels) and self.kind == "ai"
        return timebase / (
            divisor or max(1, int(timebase / asked * (1 + 1e-9)) if down else round(timebase / asked))
        )

    @property
    def timebase_hz(self) -> float:
        """Frequency of the sample clock's timebase."""
        return self.device.product.clock_hz

    @property
    def samples_asked(self) -> int:
        """Configured number of samples per channel."""
        return int(self.setting("Timing", "SAMP_QUANT_SAMP_PER_CHAN", 1000))

    @property
    def total(self) -> int | None:
        """Samples per channel of a finite task; None for a task that runs until it is stopped."""
        mode = self.setting("Timing", "SAMP_QUANT_SAMP_MODE", AcquisitionType.CONTINUOUS.value)
        if mode != AcquisitionType.FINITE.value or (self.retriggered and self.kind != "co"):
            return None
        return self.samples_asked

    @property
    def retriggered(self) -> bool:
        """True when each start trigger starts it again, until it is stopped."""
        return self.has_start_trigger and bool(self.setting("Trig", "START_TRIG_RETRIGGERABLE", False))

    @property
    def start_delay(self) -> float:
        """Time from the start trigger to the first sample (s)."""
        delay = float(self.setting("Trig", "START_TRIG_DELAY", 0.0))
        units = self.setting("Trig", "START_TRIG_DELAY_UNITS", DigitalWidthUnits.SAMPLE_CLOCK_PERIODS.value)
        own = {DigitalWidthUnits.SECONDS.value: 1.0, DigitalWidthUnits.TICKS.value: self.timebase_hz}
        return delay / own.get(units, self.rate_hz)

    @property
    def single_point(self) -> bool:
        """True when the clock times single samples, without a buffer."""
        mode = self.setting("Timing", "SAMP_QUANT_SAMP_MODE")
        return bool(mode == AcquisitionType.HW_TIMED_SINGLE_POINT.value)

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
        same = sum(c.device == self.device for c in self.channels)
        return convert_interval(product, self.rate_hz if self.timed else 1.0, same)

    def delay(self, index: int) -> float:
        """Return the delay of channel `index`'s conversion after the clock edge (s), in its card's order."""
        device = self.channels[index].device
        before = sum(channel.device == device for channel in self.channels[:index])
        late = 0.0 if device.product.ai_simultaneous else before * self.interval
        return late - (device.product.filter_delay(self.rate_hz) if self.timed else 0.0)

    @property
    def skew(self) -> float:
        """Delay of the last channel's conversion after the clock edge (s)."""
        if self.kind != "ai":
            return 0.0
        return max(0.0, *(self.delay(i) for i in range(len(self.channels))))

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
        if self.kind == "co":
            return sum(train.begun(now) for train in self.trains[:1])
        if not self.timed:
            return self.on_demand
        if self.kind == "ci" and self.implicit:
            return self._limited(min((meter.done(now) for meter in self.meters), default=0))
        if self.edges is not None:
            return self._limited(self.edges.count(now))
        edges = max(0, self.clock.edges(now - self.skew) - self.offset)
        if self.pretrigger is not None and self.total is not None:
            # Nothing can be read before the trigger, and then what came before it too.
            return 0 if self.reference is None else self._limited(max(0, edges - self.base))
        return self._limited(edges)

    @property
    def base(self) -> int:
        """Index of the first sample that is kept: 0, except before a reference trigger."""
        return 0 if self.reference is None else self.reference - (self.pretrigger or 0)

    def waits(self) -> bool:
        """True when the next sample waits for an external signal."""
        signals = self.meters or self.edges or self.trigger
        return bool(signals) or (self.pretrigger is not None and self.reference is None)

    def _limited(self, count: int) -> int:
        return count if self.total is None else min(count, self.total)

    def ready(self, samples: int) -> float | None:
        """Return the time when `samples` samples per channel are complete (s); None if never or unknown."""
        if self.total is not None and samples > self.total:
            return None
        if self.kind == "co":
            return max((train.end for train in self.trains), default=None)
        if (self.meters and self.implicit) or self.edges is not None:
            return None
        if self.pretrigger is not None and self.reference is None:
            return None
        edge = self.clock.time(self.offset + self.base + samples - 1)
        return None if edge is None else edge + self.skew

    def done(self, now: float) -> bool:
        """Return True when the task has no more samples to acquire or put out."""
        if not self.running or (not self.timed and self.kind != "co"):
            return True
        if self.failure is not None:
            return True
        if self.kind == "co":
            return bool(self.trains) and all(train.end <= now for train in self.trains)
        if self.total is not None and self.count(now) >= self.total + self.late:
            return True
        if self.late:
            return bool(self.clock.edges(now) - self.offset > (self.total or 0))
        return bool(self.clock.total is not None and self.clock.edges(now - self.skew) >= self.clock.total)

    @property
    def late(self) -> int:
        """Pulses beyond its samples that it needs to be done: 1 of old cards on another's clock."""
        return int(self.kind == "ao" and self.shares is not None and self.device.product.ends_late)

    @property
    def emits(self) -> set[str]:
        """Terminals that it drives while it runs."""
        names = {self.device.name, self.device.chassis or self.device.name}
        if self.kind == "co":
            number = re.sub(r"\D", "", self.channels[0].physical[0])
            return {f"/{name}/Ctr{number}InternalOutput" for name in names}
        if self.kind == "ci":
            return set()
        emitted = {
            f"/{name}/{self.kind}/{signal}" for name in names for signal in ("SampleClock", "StartTrigger")
        }
        return emitted | (
            {f"/{name}/ChangeDetectionEvent" for name in names} if self.detects_changes else set()
        )

    @property
    def resources(self) -> set[tuple[str, str]]:
        """What it alone can have: sampling engine, outputs, counters."""
        keys: set[tuple[str, str]] = set()
        for channel in self.channels:
            device = channel.device.name
            if channel.kind == "ai":
                keys.add((device, "ai"))
            elif channel.kind in ("ao", "ci", "co"):
                keys.update((device, name) for name in channel.physical)
            elif channel.kind == "do":
                keys.update((device, f"do {name}") for name in channel.physical)
            if self.timed and channel.kind in ("ao", "di", "do"):
                keys.add((device, f"{channel.kind} sample clock"))
        return keys
