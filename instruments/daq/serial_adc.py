"""A board that streams samples over a serial port: a load cell's HX711, an Arduino, a Teensy.

It may be a rig's only DAQ (`[daq]`), on its own clock, or be recorded along with another one (`[adc]`), and
then `free_running.py` places its samples. Its frames are declared in the rig file (`serial_codec.py`); it
needs no firmware of ours. A damaged or lost frame of an only DAQ is an error; recorded along, a few are
bridged by a straight line, and counted among the recording's readings.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from ...base.arrays import BoolArray, FloatArray
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError
from ..driver import one_name
from ..recorded_along import Reading
from ..tape import taped_line
from ..transport import ByteLine, SerialBytes, TapedBytes
from .free_running import ArrivalClock, Edge, FreeRunning
from .role import Block, Stream, StreamRequest
from .serial_codec import Decoder, Frame, SerialSettings

_LATE = 2.0
"""Time without a frame after which the board counts as silent (s)."""
_STEP = 0.005
_KEPT = 30.0
"""Time for which samples are kept for who places them (s)."""
_OFF = 0.01
"""Relative difference of a declared rate, and of the one that arrivals tell, from which it is wrong."""
_SURE = 5.0
"""Time after which arrivals tell the rate that well (s)."""


class SerialAdc(FreeRunning):
    """See `Daq` and `FreeRunning`."""

    taped = True

    class Settings(SerialSettings):
        """The `[daq]` or `[adc]` table of a rig file."""

    reads: tuple[str, ...] = ("frames lost", "time uncertainty")
    reads_hz = 1.0

    def __init__(self, settings: Settings, clock: Clock, line: ByteLine) -> None:
        self._settings, self.clock, self._line = settings, clock, line
        self.identity = f"Serial ADC at {settings.port}"
        self.channels = MappingProxyType({name: channel.range for name, channel in settings.channels.items()})
        edge = settings.edge
        self.edge = None if edge is None else Edge(edge.channel, edge.threshold)
        self._lost = 0
        self._decoder = Decoder(settings.frame)
        # A board that starts anew when its port is opened sends nothing meanwhile.
        self._started = clock.now() + 5 * _LATE
        self._times = ArrivalClock(settings.rate_hz)
        self._frames: list[Frame] = []
        self._first = 0
        """Number of the first of the frames that are kept; the board's first frame has 0."""
        self._counted: float | None = None
        self._edges: list[float] = []
        self._high = True
        self._corrected: float | None = None
        self._told: dict[str, float] = {}
        self._began = False

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: the port."""
        return (f"serial port {one_name(settings.port)}",)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Open the port. Raises InstrumentError."""
        return cls(
            settings,
            clock,
            TapedBytes(taped_line(), lambda: SerialBytes("serial ADC", settings.port, settings.baud, clock)),
        )

    # As the only DAQ

    def _stream(self, request: StreamRequest) -> Stream:
        unknown = [*(name for name in request.channels if name not in self.channels), *request.play]
        if unknown:
            raise ConfigurationError(
                f"The DAQ has no channel {unknown[0]!r}; the rig file names {', '.join(self.channels)}, and "
                f"{self.identity} has no outputs."
            )
        own, rate_hz = self._settings.rate_hz, request.rate_hz
        if not abs(rate_hz - own) <= 1e-9 * own:
            raise ConfigurationError(
                f"{self.identity} sends {own:g} frames a second, and {rate_hz:g} were asked for: write "
                f"rate_hz = {own:g} at the top of the rig file."
            )
        return _SerialStream(self, request)

    def zero(self) -> None:
        """See `Daq.zero`: it has no outputs."""

    def close(self) -> None:
        """See `Daq.close`."""
        self._line.close()

    # Recorded along

    @property
    def uncertainty(self) -> float:
        """See `FreeRunning`: half a frame once an edge has measured the latency, before it
        `latency_error`.
        """
        frame = 0.5 / self._times.rate_hz
        return frame if self._corrected is not None else max(frame, self._settings.latency_error)

    @property
    def lost(self) -> int:
        """Frames that were lost or damaged since it was opened."""
        return self._lost

    @property
    def latency(self) -> float:
        """Shortest time from a sample to its arrival (s), as an edge has measured it, or else as declared."""
        return self._settings.latency + (self._corrected or 0.0)

    def settle(self) -> None:
        """See `FreeRunning.settle`."""
        deadline, heard = max(self._started, self.clock.now() + _LATE), self.end
        self.follow(0.0)
        while not self._times.ready:
            self.follow(_STEP)
            if self.end > heard:
                deadline, heard = max(deadline, self.clock.now() + _LATE), self.end
            if self.clock.now() > deadline:
                raise self.silent()
            self.clock.sleep(_STEP)

    def follow(self, wait: float) -> float:
        """See `FreeRunning.follow`."""
        self.take(wait)
        oldest = self.end - round(_KEPT * self._settings.rate_hz)
        if oldest > self._first:
            del self._frames[: oldest - self._first]
            self._first = oldest
        return self.time_of(self.end - 1) if self.end else -np.inf

    def at(self, channels: Sequence[str], times: FloatArray) -> tuple[FloatArray, BoolArray]:
        """See `FreeRunning.at`."""
        numbers = np.arange(self._first, self.end)
        whole = np.array([frame is not None for frame in self._frames], dtype=np.bool_)
        known = self._times.at(numbers[whole].astype(np.float64)) - self.latency
        if not len(known):
            raise self.silent()
        inside = known[max(bisect_left(known, times[0]) - 1, 0) : bisect_left(known, times[-1]) + 1]
        widest = float(np.diff(inside).max(initial=0.0))
        if widest > self._settings.bridge + 1.5 / self._settings.rate_hz:
            raise InstrumentError(
                f"{self.identity} lost {round(widest * self._settings.rate_hz) - 1} frames in a row "
                f"({widest:.3g} s): check its cable, its power and its program; 'bridge' in [adc] says how "
                "long a gap may be."
            )
        rows = self.volts([frame for frame in self._frames if frame is not None], channels)
        volts = np.array([np.interp(times, known, row) for row in rows])
        ranges = np.array([self.channels[name] for name in channels])
        return volts, _overload(volts, ranges)

    def edges(self) -> list[float]:
        """See `FreeRunning.edges`."""
        found, self._edges = self._edges, []
        return found

    def correct(self, late: Sequence[float]) -> None:
        """See `FreeRunning.correct`: from the next stream on."""
        if late:
            self._corrected = (self._corrected or 0.0) + float(np.median(late))

    # Readings: see `RecordedAlong`

    def start(self, stem: Path, clock: Clock) -> None:
        """Forget what was told in another recording."""
        self._told = {}

    def read(self) -> Sequence[Reading]:
        """Tell the frames lost so far, and how well the samples' times are known, when either has changed."""
        now = {"frames lost": float(self.lost), "time uncertainty": round(self.uncertainty, 6)}
        units = {"frames lost": "frames", "time uncertainty": "s"}
        told = [
            Reading(name, value, units[name]) for name, value in now.items() if self._told.get(name) != value
        ]
        self._told = now
        return told

    def stop(self) -> Sequence[Reading]:
        """Do nothing: the board goes on."""
        return ()

    # For streams

    @property
    def end(self) -> int:
        """Number of the frame that comes next."""
        return self._first + len(self._frames)

    def frames(self, first: int, end: int) -> list[Frame]:
        """Frames that have come."""
        return self._frames[first - self._first : end - self._first]

    def drop(self, before: int) -> None:
        """Forget frames."""
        del self._frames[: max(before - self._first, 0)]
        self._first = max(before, self._first)

    def take(self, wait: float) -> None:
        """Take what has arrived. Raises InstrumentError."""
        if not self._began:
            self._began = True
            if self._settings.start:
                self._line.send(self._settings.start.encode())
        for time, data in self._line.arrived(wait):
            came = self._decoder.feed(data)
            for frame in came:
                self._number(frame)
            if came:
                # The last frame of what came together was delayed least.
                self._times.note(self.end - 1, time)
                self._note_slip()

    def time_of(self, number: int) -> float:
        """When a frame was sampled (s)."""
        return float(self._times.at(np.array([float(number)]))[0]) - self.latency

    def volts(self, frames: Sequence[Any], channels: Sequence[str]) -> FloatArray:
        """(channels, frames) V of whole frames."""
        raw = np.array(frames, dtype=np.float64).reshape(len(frames), self._settings.frame.width)
        columns = [self._settings.channels[name] for name in channels]
        return np.array([one.scale * raw[:, one.column - 1] + one.offset for one in columns])

    def silent(self) -> InstrumentError:
        """The error of a board that sends nothing that can be read."""
        if self.lost:
            return InstrumentError(
                f"{self.identity} sends nothing that reads as 'frame' says ({self.lost} were damaged): "
                "correct 'frame' and 'baud', there or on the board."
            )
        return InstrumentError(
            f"{self.identity} sends nothing that reads as 'frame' says: check 'port', 'baud', 'frame' and "
            "'start', and that its program runs."
        )

    def refuse_rate(self) -> None:
        """Raise ConfigurationError when arrivals tell another rate than the rig file."""
        told, declared = self._times.rate_hz, self._settings.rate_hz
        if self.end > _SURE * declared and abs(told / declared - 1) > _OFF:
            raise ConfigurationError(
                f"{self.identity} sends {told:.4g} frames a second, and the rig file says {declared:g}: "
                f"write rate_hz = {told:.4g}, in its table and, as the only DAQ, at the top."
            )

    def _note_slip(self) -> None:
        """Number the frames anew when arrivals tell that some were lost, which without a counter nothing else
        does.
        """
        slip, self._times.slip = self._times.slip, 0.0
        missed = round(slip * self._times.rate_hz)
        if missed and self._settings.counter is None:
            self._frames += [None] * missed
            self._lost += missed

    def _number(self, frame: Frame) -> None:
        """Append a frame, after as many damaged ones as the counter tells to have been lost."""
        settings = self._settings
        if frame is not None and settings.counter is not None:
            counted = frame[settings.counter - 1]
            if self._counted is not None:
                missed = int(counted - self._counted - 1) % settings.counter_modulo
                # Damaged frames since the last whole one are among those that the counter skips.
                damaged = next(
                    (n for n, f in enumerate(reversed(self._frames)) if f is not None), len(self._frames)
                )
                self._frames += [None] * max(missed - damaged, 0)
                self._lost += max(missed - damaged, 0)
            self._counted = counted
        if frame is None:
            self._lost += 1
        self._frames.append(frame)
        if frame is not None and settings.edge is not None:
            high = frame[settings.edge.column - 1] > settings.edge.level
            if high and not self._high:
                # It rose at some time between the frame before and this one.
                self._edges.append(self.time_of(self.end - 1) - 0.5 / self._times.rate_hz)
            self._high = high


def _overload(volts: FloatArray, ranges: FloatArray) -> BoolArray:
    return np.asarray(np.any(np.abs(volts) >= ranges[:, np.newaxis] * (1 - 1e-6), axis=1))


class _SerialStream(Stream):
    """See `Stream`: the frames of an only DAQ."""

    def __init__(self, daq: SerialAdc, request: StreamRequest) -> None:
        self.channels, self.rate_hz = request.channels, daq._settings.rate_hz
        self.delays = np.zeros(len(self.channels))
        self.full_scale = np.array([daq.channels[name] for name in self.channels])
        self._daq, self._request = daq, request
        self._open = True
        daq.take(0.0)
        self._begin = daq.end

    def __iter__(self) -> Iterator[Block]:
        """See `Stream.__iter__`."""
        daq = self._daq
        for first, count in self._request.blocks():
            if not self._open:
                return
            begin = self._begin + first
            self._wait(begin + count)
            daq.refuse_rate()
            frames = daq.frames(begin, begin + count)
            if len(frames) < count:
                return  # it was closed
            missing = [n for n, frame in enumerate(frames) if frame is None]
            if missing:
                raise InstrumentError(
                    f"{daq.identity} lost or damaged {len(missing)} frames from sample {first + missing[0]} "
                    "on: check its cable, its power and its program."
                )
            daq.drop(begin + count)
            volts = daq.volts(frames, self.channels)
            yield Block(first, volts, _overload(volts, self.full_scale))

    def close(self) -> None:
        """See `Stream.close`."""
        self._open = False

    def _wait(self, end: int) -> None:
        """Wait for the frames before `end`."""
        daq, heard = self._daq, self._daq.end
        deadline = daq.clock.now() + (end - heard) / self.rate_hz + _LATE
        daq.take(0.0)
        while self._open and daq.end < end:
            daq.clock.sleep(max((end - daq.end) / self.rate_hz, _STEP))
            daq.take(_STEP)
            if daq.end > heard:
                heard = daq.end
                deadline = daq.clock.now() + (end - heard) / self.rate_hz + _LATE
            if daq.clock.now() > deadline:
                raise daq.silent()
