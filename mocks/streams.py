"""Simulated senders of LSL streams, on a clock of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..instruments.streams import LslStreams, header
from ..instruments.streams.lsl import Wanted
from .plant import OnStreams, Plant

# Twin of LSL: each stream that a rig file wants has a sender, another computer with a clock of its own.
#
# What pylsl's functions and classes would answer, on the plant's time. The sender sees the finger: a stream
# of the type "Markers" has a text when a press begins and when it ends, at no steady rate; any other has the
# force and a count of samples, 250 times a second. Figures are estimates.

OFFSET = -86_012.25
"""What the sender's clock shows when the plant's shows 0 (s): it was switched on another day."""
DRIFT = 40e-6
"""By how much faster it runs; crystals differ by 5 to 50 ppm (docs/hardware.md, "Two cards on one clock")."""
_RATE_HZ = 250.0
_DELAY = 0.03
"""Time from a sample to its arrival (s)."""
_ONE_WAY = 2e-4
"""Mean time that a packet of LSL's measurements waits on the way, there or back (s)."""
_PACKETS = 8
"""Packets of one measurement: LSL's own number."""
_EVERY = 2.0
"""Time between two measurements (s): LSL's own."""
_MARKED = 1.0
"""Force (N) at which a press begins and ends for a sender of markers."""
_STEP = 1e-3
"""How finely it looks at the force (s)."""
_HERE = 512.0
"""What LSL's clock of this computer shows when the plant's shows 0 (s)."""


class _LostError(RuntimeError):
    """As pylsl's."""


@dataclass(frozen=True)
class _Info:
    """As pylsl's StreamInfo."""

    key: str
    """What the rig file calls it."""
    wanted: Wanted

    def name(self) -> str:
        return self.wanted.name or self.key

    def type(self) -> str:
        return self.wanted.type or "simulated"

    def source_id(self) -> str:
        return self.wanted.source_id or "simulated"

    def hostname(self) -> str:
        return "simulated"

    def nominal_srate(self) -> float:
        return 0.0 if self.marks else _RATE_HZ

    def channel_format(self) -> int:
        return 3 if self.marks else 2

    def channel_count(self) -> int:
        return len(self.channels)

    @property
    def marks(self) -> bool:
        return self.wanted.type == "Markers"

    @property
    def channels(self) -> Sequence[tuple[str, str]]:
        return [("press", "none")] if self.marks else [("force", "N"), ("count", "none")]

    def as_xml(self) -> str:
        return header(
            self.name(),
            self.type(),
            self.nominal_srate(),
            self.channel_format(),
            self.channels,
            self.source_id(),
            {"simulated": "true"},
        )


class _Inlet:
    """As pylsl's StreamInlet, of a stream that begins with it."""

    def __init__(self, info: _Info, plant: Plant) -> None:
        self._info, self._plant = info, plant
        self._rng = plant.rng(f"stream {info.key}")
        self._next = int(np.ceil(plant.clock.now() * _RATE_HZ))
        self._seen = plant.clock.now()
        self._pressed = False
        self._measured, self._correction = -np.inf, 0.0

    def info(self, timeout: float) -> _Info:
        return self._info

    def open_stream(self, timeout: float) -> None:
        self._alive()

    def time_correction(self, timeout: float) -> float:
        self._alive()
        now = self._plant.clock.now()
        if now - self._measured >= _EVERY:
            self._measured = now
            # Of several packets LSL takes the quickest; half of the difference between its ways remains.
            there, back = min(self._rng.exponential(_ONE_WAY, (_PACKETS, 2)), key=sum)
            self._correction = _HERE + now - _sender(now) + (there - back) / 2
        return float(self._correction)

    def pull_chunk(self, timeout: float, max_samples: int) -> tuple[list[list[Any]], list[float]]:
        until = self._plant.clock.now() - _DELAY
        rows, times = self._marks(until) if self._info.marks else self._samples(until, max_samples)
        lost = ("samples_lost", "stream_lost")
        kept = [
            n for n, time in enumerate(times) if not any(self._faulty(hook, float(time)) for hook in lost)
        ]
        if not kept:
            self._alive()
        return [rows[n] for n in kept], [_sender(float(times[n])) for n in kept]

    def _samples(self, until: float, most: int) -> tuple[list[list[Any]], FloatArray]:
        numbers = np.arange(self._next, min(int(until * _RATE_HZ) + 1, self._next + most))
        if not len(numbers):
            return [], np.zeros(0)
        self._next = int(numbers[-1]) + 1
        times = numbers / _RATE_HZ
        force = self._plant.force(times)
        return [[float(f), float(n)] for f, n in zip(force, numbers, strict=True)], times

    def _marks(self, until: float) -> tuple[list[list[Any]], FloatArray]:
        rows: list[list[Any]] = []
        times = []
        grid = np.arange(self._seen, until, _STEP)
        if len(grid):
            self._seen = float(grid[-1]) + _STEP
            for time, force in zip(grid, self._plant.force(grid), strict=True):
                if (force > _MARKED) != self._pressed:
                    self._pressed = not self._pressed
                    rows.append(["press begins" if self._pressed else "press ends"])
                    times.append(time)
        return rows, np.array(times)

    def _alive(self) -> None:
        if self._faulty("stream_lost", self._plant.clock.now()):
            raise _LostError("the stream has been lost.")

    def _faulty(self, hook: str, time: float) -> bool:
        return any(getattr(fault, hook)(self._info.key, time) for fault in self._plant.faults.at(OnStreams))


def _sender(time: float) -> float:
    """The sender's clock at a time of the plant (s)."""
    return OFFSET + (1 + DRIFT) * time


def twin(settings: LslStreams.Settings, plant: Plant) -> LslStreams:
    """Create the twin: the real driver, on simulated senders."""

    def resolve_streams(wait: float) -> list[_Info]:
        now = plant.clock.now()
        return [
            _Info(key, wanted)
            for key, wanted in settings.inlets.items()
            if not any(fault.stream_lost(key, now) for fault in plant.faults.at(OnStreams))
        ]

    library = SimpleNamespace(
        resolve_streams=resolve_streams,
        StreamInlet=lambda info, recover: _Inlet(info, plant),
        local_clock=lambda: _HERE + plant.clock.now(),
    )
    return LslStreams(settings, plant.clock, library)
