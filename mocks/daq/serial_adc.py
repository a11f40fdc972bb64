"""Twin and wire of a board that streams samples: a clock of its own, and frames that arrive late by turns."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray
from ...instruments.daq.serial_adc import SerialAdc
from ...instruments.transport import Arrival
from ...nidaqmx_twin.nodes import SamplesLost
from ..plant import Plant
from ..transport import Loopback

DRIFT = -0.013
"""Relative excess of the board's rate over the nominal one: of an HX711's own oscillator, which its data
sheet does not state (estimate)."""
CRYSTAL = 50e-6
"""The same of a rate of 200 Hz and more, which a crystal makes (estimate)."""
WAIT = 0.008
"""Longest time between two turns in which a USB adapter hands over what has come (s; estimate)."""
_POLL = 0.002
"""Real time between two looks of the wire for frames that are due (s)."""


@dataclass
class Board:
    """A board on the plant, whose faults are counted in frames from its first one."""

    settings: SerialAdc.Settings
    plant: Plant
    drift: float = 0.0
    latency: float = 0.0
    """Shortest time from a sample to its arrival (s)."""
    loses: frozenset[int] = frozenset()
    """Frames that never arrive."""
    damages: frozenset[int] = frozenset()
    """Frames whose bytes are damaged."""
    silent_from: int | None = None
    noise: float = 0.5
    """Noise of a column (rms, in its last digit)."""

    def __post_init__(self) -> None:
        settings = self.settings
        self.drift = self.drift or (DRIFT if settings.rate_hz < 200 else CRYSTAL)
        self.latency = self.latency or settings.latency
        self._begin = self.plant.clock.now()
        self._sent, self._turn = 0, self._begin
        self._rng = self.plant.rng("serial ADC")
        self._ready: list[Arrival] = []
        for name in settings.channels:
            self.plant.sample_by(name, "serial adc")

    @property
    def period(self) -> float:
        """Time between two frames (s of the plant)."""
        return 1 / (self.settings.rate_hz * (1 + self.drift))

    def due(self) -> list[Arrival]:
        """Bytes that have arrived since the last call, with the times of their arrival."""
        now = self.plant.clock.now()
        made = int((now - self._begin) / self.period) - self._sent
        if made > 0:
            self._make(made)
        count = next((n for n, (time, _) in enumerate(self._ready) if time > now), len(self._ready))
        came, self._ready = self._ready[:count], self._ready[count:]
        return came

    def sampled(self, number: int) -> float:
        """When a frame was sampled (s of the plant)."""
        return self._begin + (number + 1) * self.period

    def _make(self, count: int) -> None:
        settings = self.settings
        numbers = np.arange(self._sent, self._sent + count, dtype=np.float64)
        times = np.asarray(self._begin + (numbers + 1) * self.period)
        self._sent += count
        columns = self._columns(numbers, times)
        for number, time, values in zip(map(int, numbers), times, columns.T, strict=True):
            # Handed over by turns, as USB does.
            while self._turn < time + self.latency:
                self._turn += float(self._rng.uniform(0.1, 1.0)) * WAIT
            if number in self.loses or (self.silent_from is not None and number >= self.silent_from):
                continue
            frame = settings.frame.encode(values)
            if number in self.damages:
                frame = bytes(byte ^ 0x55 for byte in frame[:-1]) + frame[-1:]
            self._ready.append((self._turn, frame))

    def _columns(self, numbers: FloatArray, times: FloatArray) -> FloatArray:
        settings = self.settings
        raw = np.zeros((settings.frame.width, len(times)))
        names = list(settings.channels)
        try:
            volts = self.plant.read(names, np.tile(times, (len(names), 1)))
        except SamplesLost:
            self.loses |= set(map(int, numbers))
            volts = np.zeros((len(names), len(times)))
        for name, row in zip(names, volts, strict=True):
            channel = settings.channels[name]
            raw[channel.column - 1] = (
                np.clip(row, -channel.range, channel.range) - channel.offset
            ) / channel.scale
            digit = settings.digit(channel)
            raw[channel.column - 1] += self.noise * digit * self._rng.standard_normal(len(times))
            raw[channel.column - 1] = np.rint(raw[channel.column - 1] / digit) * digit
        if settings.counter is not None:
            raw[settings.counter - 1] = numbers % settings.counter_modulo
        edge = settings.edge
        if edge is not None and edge.column not in {c.column for c in settings.channels.values()}:
            raw[edge.column - 1] = self.plant.read([edge.channel], times[np.newaxis, :])[0] > edge.threshold
        for column, row in enumerate(raw):
            low, high = settings.frame.limits(column)
            np.clip(row, low, high, out=row)
        return raw


class _Line:
    """See `ByteLine`: a board in the same process."""

    def __init__(self, board: Board) -> None:
        self.board = board

    def arrived(self, wait: float) -> list[Arrival]:
        """See `ByteLine.arrived`."""
        return self.board.due()

    def send(self, data: bytes) -> None:
        """See `ByteLine.send`: the board streams from the beginning."""

    def close(self) -> None:
        """See `ByteLine.close`."""


class BoardServer(Loopback):
    """A board on a socket: sends what is due to whoever is connected."""

    def __init__(self, board: Board, port: int = 0) -> None:
        self.board = board
        super().__init__(self._stream, port)

    def _stream(self, link: socket.socket) -> None:
        while not self.closing.wait(_POLL):
            data = b"".join(part for _, part in self.board.due())
            if data:
                link.sendall(data)


def twin(settings: SerialAdc.Settings, plant: Plant) -> SerialAdc:
    """Create the twin: the real driver's class, on a simulated board."""
    return SerialAdc(settings, plant.clock, _Line(Board(settings, plant)))


@contextmanager
def wire(settings: SerialAdc.Settings, plant: Plant) -> Iterator[dict[str, object]]:
    """Serve a simulated board; yield the settings that point the driver at it."""
    with BoardServer(Board(settings, plant)) as server:
        yield {"port": f"socket://{server.address}"}
