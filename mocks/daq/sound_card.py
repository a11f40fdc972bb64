"""Twin of the sound card as a DAQ: an imitation of the module `sounddevice`, on the plant's clock.

The real driver's class runs on it. As the plant advances, whoever reads, the callback is called for each
period that has passed on the card's clock: it gets what the inputs heard in that period, and what it returns
comes out `latency` frames after the frame of the same number was heard.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...base.arrays import FloatArray
from ...instruments.daq.sound_card import SoundCardDaq
from ...instruments.portaudio import on_tape
from ...instruments.tape import taped_line
from ...nidaqmx_twin.nodes import PlayStopped, Run, SamplesLost
from ..plant import Plant
from ..portaudio import FRAMES, CallbackAbort, CallbackStop, Coupling, Flags, PortAudioError

DRIFT = 30e-6
"""Relative excess of the card's clock rate over the rig's (estimate, as all here; docs/hardware.md, "Sound
card")."""
LATENCY = 1152
"""Frames from an output to an input that hears it, where the rig file says none."""
NOISE = 1e-5
"""Noise of the inputs, of full scale rms: -100 dB."""
_BITS = 24
_SETTLES = 0.5
"""Time for the coupling capacitor to discharge (s)."""
_KEPT = 2.0
"""Time for which an output remembers what it has put out, for a cable to an input (s)."""


def twin(settings: SoundCardDaq.Settings, plant: Plant) -> SoundCardDaq:
    """Create the twin: the real driver's class, on a simulated card that is set as the rig file says."""
    return SoundCardDaq(settings, plant.clock, on_tape(taped_line(), DuplexCard(settings, plant)))


class Line:
    """One output: a `Source` for the plant, without a reference to the plant."""

    def __init__(self, full_scale: float, high_pass_hz: float) -> None:
        self.full_scale = full_scale
        """Volts at digital full scale, which depend on the operating system's volume."""
        self.high_pass_hz = high_pass_hz
        self._coupling = Coupling()
        self._waiting: deque[Run] = deque()
        self._past: deque[Run] = deque()

    def put(self, run: Run) -> None:
        """Let `run` (of full scale) come out, in place of what waits for the same time and later."""
        while self._waiting and (last := self._waiting.pop()):
            before, _ = _until(last, run.start - run.period / 2)
            if len(before.values):
                self._waiting.append(before)
                break
        self._waiting.append(run)

    def drop(self, now: float) -> None:
        """Drop what would come out after `now` (s); the capacitor discharges."""
        kept = [_until(run, now)[0] for run in self._waiting]
        self._waiting = deque(run for run in kept if len(run.values))
        period = min((run.period for run in [*self._waiting, *self._past]), default=1 / 48_000)
        self._waiting.append(Run(now, period, np.zeros(round(_SETTLES / period))))

    def take(self, until: float) -> Sequence[Run]:
        """See `haploop.nidaqmx_twin.nodes.Source.take`."""
        runs = []
        while self._waiting and self._waiting[0].start <= until:
            run, rest = _until(self._waiting.popleft(), until)
            if len(rest.values):
                self._waiting.appendleft(rest)
            volts = run.values * self.full_scale
            if self.high_pass_hz:
                volts = self._coupling.passed(volts, self.high_pass_hz, run.period)
            runs.append(Run(run.start, run.period, volts))
        self._past.extend(runs)
        while self._past and self._past[0].start < until - _KEPT:
            self._past.popleft()
        return runs

    def volts(self, times: FloatArray) -> FloatArray:
        """Volts that stood on it at past times, (times,) s."""
        asked: list[Run] = []
        for run in reversed(self._past):
            if run.start <= times[-1] + 1e-9:
                asked.append(run)
            if run.start <= times[0] + 1e-9:
                break
        else:
            asked.append(Run(-np.inf, np.inf, np.zeros(1)))
        asked.reverse()
        steps = np.concatenate([run.times for run in asked])
        values = np.concatenate([run.values for run in asked])
        return np.asarray(values[np.searchsorted(steps, times + 1e-9, side="right") - 1])


def _until(run: Run, time: float) -> tuple[Run, Run]:
    """Divide a run at a time: what comes out until then, and what later."""
    count = int(np.clip(np.floor((time - run.start) / run.period + 1e-3) + 1, 0, len(run.values)))
    later = Run(run.start + count * run.period, run.period, run.values[count:])
    return Run(run.start, run.period, run.values[:count]), later


class DuplexCard:
    """A card whose inputs and outputs are wired to nodes of the plant, as the rig file names them."""

    CallbackStop: type[Exception] = CallbackStop
    CallbackAbort: type[Exception] = CallbackAbort
    PortAudioError: type[Exception] = PortAudioError

    def __init__(self, settings: SoundCardDaq.Settings, plant: Plant) -> None:
        self.plant = plant
        self.drift = DRIFT
        self.latency = max(settings.latency or LATENCY, FRAMES)
        """Frames from an output to an input that hears it."""
        self.inputs = {channel.input - 1: name for name, channel in settings.channels.items()}
        self.full_scale = {name: channel.volts_per_full_scale for name, channel in settings.channels.items()}
        """Volts of each input at digital full scale, which depend on its gain knob."""
        self.high_pass_hz = {name: channel.high_pass_hz for name, channel in settings.channels.items()}
        self.lines = {
            output.output - 1: Line(output.volts_per_full_scale, output.high_pass_hz)
            for output in settings.outputs.values()
        }
        self.named = {name: self.lines[output.output - 1] for name, output in settings.outputs.items()}
        self.overflows_at: int | None = None
        """Frame at which a period of the inputs is lost once; None for never."""
        self.starves_at: int | None = None
        """Frame at which the outputs once get a period of silence instead; None for never."""
        self.dies_at: int | None = None
        """Frame at which the device stops calling back; None for never."""
        self.rng = plant.rng("sound card's inputs")
        self.open: _Stream | None = None
        for name, line in self.named.items():
            plant.drive(name, line)
        for name in settings.channels:
            plant.sample_by(name, "sound card")

    def query_devices(self, device: int | str | None, kind: str) -> dict[str, object]:
        """Imitate `sounddevice.query_devices`."""
        most = max([*self.inputs, *self.lines]) + 1
        return {"name": "Sound card (twin)", "max_input_channels": most, "max_output_channels": most}

    def OutputStream(self, **settings: Any) -> _Stream:  # noqa: N802  as sounddevice calls it
        """Imitate `sounddevice.OutputStream`, of which this driver has no use."""
        raise PortAudioError("Invalid device")

    def InputStream(self, **settings: Any) -> _Stream:  # noqa: N802
        """Imitate `sounddevice.InputStream`."""
        return _Stream(self, (settings.pop("channels"), 0), **settings)

    def Stream(self, **settings: Any) -> _Stream:  # noqa: N802
        """Imitate `sounddevice.Stream`."""
        return _Stream(self, settings.pop("channels"), **settings)

    def heard(
        self, inputs: int, times: FloatArray, period: float, couplings: dict[str, Coupling]
    ) -> FloatArray:
        """What the first `inputs` give at `times` ((times,) s), (times, inputs) of full scale.

        Raises SamplesLost.
        """
        wired = {row: name for row, name in self.inputs.items() if row < inputs}
        rows = self.plant.read(list(wired.values()), np.tile(times, (len(wired), 1)))
        given = NOISE * self.rng.standard_normal((len(times), inputs))
        for (row, name), read in zip(wired.items(), rows, strict=True):
            plugged = self.plant.cables.get(name)
            volts = read if plugged is None else self.named[plugged].volts(times)
            if self.high_pass_hz[name]:
                if name not in couplings:
                    couplings[name] = Coupling()
                    couplings[name].settle(float(volts[0]))
                volts = couplings[name].passed(volts, self.high_pass_hz[name], period)
            given[:, row] += volts / self.full_scale[name]
        end = 2.0 ** (_BITS - 1)
        return np.asarray(np.clip(np.rint(given * end), -end, end - 1) / end)


class _Stream:
    """Imitation of `sounddevice.Stream` and `InputStream`, limited to the driver's needs."""

    def __init__(
        self,
        card: DuplexCard,
        channels: tuple[int, int],
        *,
        samplerate: float,
        callback: Callable[..., None],
        **rest: object,
    ) -> None:
        self._card, self._channels, self._callback = card, channels, callback
        self._period = 1 / (samplerate * (1 + card.drift))
        self._couplings: dict[str, Coupling] = {}
        self._start, self._done = 0.0, 0
        self._late = 0
        """Frames of silence that an underrun has put in."""
        self._lost = 0
        """Frames that an overrun has lost."""
        self._running = False

    @property
    def active(self) -> bool:
        """Imitate sounddevice's `active`; what has passed has been called back for."""
        plant = self._card.plant
        plant.advance(plant.clock.now())
        return self._running

    def call(self, until: float) -> None:
        """See `Called`."""
        while self._running and self._start + (self._done + self._lost + FRAMES) * self._period <= until:
            self._call()

    def start(self) -> None:
        """Imitate sounddevice's `start`."""
        if self._card.open is not None:
            raise PortAudioError("Device unavailable [PaErrorCode -9985]")
        self._card.open = self
        self._start = self._card.plant.clock.now()
        self._running = True
        self._card.plant.begin(self)

    def close(self, ignore_errors: bool = True) -> None:
        """Imitate sounddevice's `close`."""
        card = self._card
        if card.open is not self:
            return
        card.plant.end(self, self._drop)
        card.open = None

    def _drop(self, now: float) -> None:
        self._running = False
        for line in self._card.lines.values():
            line.drop(now)

    def _call(self) -> None:
        card, first = self._card, self._done
        flags: dict[str, bool] = {}
        if card.dies_at is not None and first >= card.dies_at:
            self._running = False
            return
        if card.overflows_at is not None and first >= card.overflows_at:
            card.overflows_at, self._lost = None, self._lost + FRAMES
            flags["input_overflow"] = True
        times = self._start + (first + self._lost + np.arange(FRAMES, dtype=np.float64)) * self._period
        indata = np.zeros((FRAMES, self._channels[0]), dtype=np.float32)
        try:
            indata[:] = card.heard(self._channels[0], times, self._period, self._couplings)
        except SamplesLost:
            flags["input_overflow"] = True
        outdata = np.zeros((FRAMES, self._channels[1]), dtype=np.float32)
        if self._channels[1]:
            self._starve(first, flags)
        status = Flags(**flags)
        self._done += FRAMES
        try:
            if self._channels[1]:
                self._callback(indata, outdata, FRAMES, None, status)
            else:
                self._callback(indata, FRAMES, None, status)
        except (CallbackStop, CallbackAbort):
            self._running = False
            return
        start = self._start + (first + self._lost + self._late + card.latency) * self._period
        for row, line in card.lines.items():
            if row < self._channels[1]:
                line.put(Run(start, self._period, np.asarray(outdata[:, row], dtype=np.float64)))

    def _starve(self, first: int, flags: dict[str, bool]) -> None:
        card = self._card
        try:
            card.plant.plays("sound card")
        except PlayStopped:
            flags["output_underflow"] = True
        if card.starves_at is not None and first >= card.starves_at:
            card.starves_at, self._late = None, self._late + FRAMES
            flags["output_underflow"] = True
