"""Twin of the sound card: an imitation of the module `sounddevice`, on the plant's clock.

The real driver's class plays through it; its callback is called for samples as the plant advances.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..instruments.player.sound_card import SoundCard
from ..instruments.portaudio import on_tape
from ..instruments.tape import taped_line
from ..nidaqmx_twin.nodes import Run
from .plant import Plant
from .portaudio import FRAMES, CallbackAbort, CallbackStop, Coupling, Flags, PortAudioError

FULL_SCALE = 1.4
"""Output at digital full scale (V peak; estimate, like all constants here; docs/hardware.md, "Sound
card")."""
HIGH_PASS_HZ = 5.0
DRIFT = 30e-6
"""Relative excess of the card's clock rate over the rig's."""
LATENCY = (0.020, 0.100)
"""Limits of the random delay from the start of a stream to its first sample (s)."""
_SETTLES = 0.5
"""Time for the coupling capacitor to discharge (s)."""


def twin(settings: SoundCard.Settings, plant: Plant) -> SoundCard:
    """Create the twin: the real driver's class, playing through a simulated card."""
    card = Card(plant, settings.output, settings.channel - 1)
    return SoundCard(settings, plant.clock, on_tape(taped_line(), card))


class Jack:
    """One channel's output: a `Source` for the plant, without a reference to the plant."""

    def __init__(self, channel: int, chance: np.random.Generator) -> None:
        self.full_scale = FULL_SCALE
        """Output at digital full scale (V peak), which depends on the operating system's volume."""
        self.drift = DRIFT
        self.high_pass_hz = HIGH_PASS_HZ
        self.starves_at: int | None = None
        """Sample before which the stream underflows once: 10 ms of silence, and a flag; None for never."""
        self.begun: list[float] = []
        """Time of each stream's first sample at the output (s)."""
        self._channel = channel
        self._chance = chance
        self._stream: _Stream | None = None
        self._start, self._period, self._given = 0.0, np.inf, 0
        self._ready = np.zeros(0)
        self._left = 0
        self._coupling = Coupling()

    def begin(self, stream: _Stream, now: float) -> None:
        """Start playing `stream` at `now` (s); its first sample comes out after a random delay."""
        if self._stream is not None:
            raise PortAudioError("Device unavailable [PaErrorCode -9985]")
        late = float(self._chance.uniform(*LATENCY))
        self._start, self._given = now, 0
        self._period = 1 / (stream.rate_hz * (1 + self.drift))
        # The coupling capacitor goes on discharging until the first sample.
        self._ready = np.zeros(max(1, round(late / self._period)))
        self.begun.append(now + len(self._ready) * self._period)
        self._stream = stream

    def end(self, stream: _Stream) -> None:
        """Drop the samples that wait; the output is silent from now on."""
        if self._stream is stream:
            self._silence()

    def take(self, until: float) -> Sequence[Run]:
        """See `haploop.nidaqmx_twin.nodes.Source.take`."""
        # The tolerance counts a step at `until` itself as past, in spite of rounding.
        past = int((until - self._start) / self._period + 1e-3) + 1 if until >= self._start else 0
        while self._given + len(self._ready) < past and self._goes_on():
            self._ready = np.concatenate([self._ready, self._next()])
        count = min(past - self._given, len(self._ready))
        if count <= 0:
            return []
        volts = self._coupling.passed(self._ready[:count], self.high_pass_hz, self._period)
        run = Run(self._start + self._given * self._period, self._period, volts)
        self._given, self._ready = self._given + count, self._ready[count:]
        if self._stream is not None and self._stream.done and not len(self._ready):
            self._stream.finished_callback()
            self._silence()
        return [run]

    def _goes_on(self) -> bool:
        return self._left > 0 if self._stream is None else not self._stream.done

    def _next(self) -> FloatArray:
        stream = self._stream
        if stream is None:
            self._left -= FRAMES
            return np.zeros(FRAMES)
        if self.starves_at is not None and stream.asked > self.starves_at:
            self.starves_at = None
            stream.flags = Flags(output_underflow=True)
            return np.zeros(FRAMES)
        frames = stream.ask(FRAMES)
        return np.asarray(frames[:, self._channel], dtype=np.float64) * self.full_scale

    def _silence(self) -> None:
        self._ready = np.zeros(0)
        self._stream = None
        self._left = round(_SETTLES / self._period)


class Card:
    """A two-channel card; one of its channels is wired to the plant's `node`."""

    CallbackStop: type[Exception] = CallbackStop
    CallbackAbort: type[Exception] = CallbackAbort
    PortAudioError: type[Exception] = PortAudioError

    def __init__(self, plant: Plant, node: str, channel: int) -> None:
        self.jack = Jack(channel, plant.rng("sound card"))
        self._plant = plant
        plant.drive(node, self.jack)

    def query_devices(self, device: int | str | None, kind: str) -> dict[str, object]:
        """Imitate `sounddevice.query_devices`."""
        return {"name": "Sound card (twin)", "max_output_channels": 2}

    def OutputStream(self, **settings: Any) -> _Stream:  # noqa: N802  as sounddevice calls it
        """Imitate `sounddevice.OutputStream`."""
        return _Stream(self, **settings)

    def InputStream(self, **settings: Any) -> _Stream:  # noqa: N802
        """Imitate `sounddevice.InputStream`, of which the player has no use."""
        raise PortAudioError("Invalid device")

    Stream = InputStream

    def now(self) -> float:
        """Advance the plant to the present, and return that time (s)."""
        now = self._plant.clock.now()
        self._plant.advance(now)
        return now


class _Stream:
    """Imitation of `sounddevice.OutputStream`, limited to the driver's needs."""

    def __init__(
        self,
        card: Card,
        *,
        samplerate: float,
        channels: int,
        dtype: str,
        callback: Callable[[Any, int, object, Any], None],
        finished_callback: Callable[[], None],
        **rest: object,
    ) -> None:
        self.rate_hz = samplerate
        self.flags = Flags()
        self.asked = 0
        """Number of samples requested so far."""
        self.done = False
        self.finished_callback = finished_callback
        self._card, self._callback = card, callback
        self._shape = (FRAMES, channels), dtype

    @property
    def active(self) -> bool:
        """Imitate sounddevice's `active`."""
        return not self.done

    def start(self) -> None:
        """Imitate sounddevice's `start`."""
        self._card.jack.begin(self, self._card.now())

    def close(self, ignore_errors: bool = True) -> None:
        """Imitate sounddevice's `close`."""
        self._card.now()
        self._card.jack.end(self)

    def ask(self, count: int) -> Any:
        """Return the next samples, (count, channels), from the callback."""
        outdata = np.zeros(*self._shape)
        flags, self.flags = self.flags, Flags()
        self.asked += count
        try:
            self._callback(outdata, count, None, flags)
        except CallbackStop:
            self.done = True
        except CallbackAbort:
            self.done = True
            outdata[:] = 0
        return outdata
