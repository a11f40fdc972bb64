"""A sound card as the DAQ: its inputs and outputs in one stream of PortAudio (optional: sounddevice).

One callback brings n frames of the inputs and takes n frames of the outputs, on the card's one clock. What an
output plays is heard by an input some frames later: converters, filters and buffers lie between. That
`latency` is constant for a card, a driver (ASIO, Core Audio, ALSA's hw devices, JACK) and a buffer size, and
is measured by a cable from output to input. Sample 0 of a stream is the input's frame that hears the
waveform's first sample. What breaks this: shared mixers (WASAPI shared, PulseAudio) with another latency each
time, and an under- or overrun, which moves the outputs against the inputs. So every overrun is an error, and
with `monitor`, an input that hears the output, each play is compared with what was heard.

Volts at full scale and volume, AC coupling: `portaudio.py` of this room.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Self

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError, LimitError
from ...base.filters import fast_length
from ...base.threads import Inbox
from ..portaudio import LEAD, Audio, AudioStream, found, high_pass, load, on_tape, refuse_mean
from ..tape import taped_line
from .role import Block, Daq, Stream, StreamRequest
from .sound_settings import SoundSettings

_LATE = 2.0
"""Delay beyond which a block counts as lost (s)."""
_POLL = 0.002
"""Interval at which a late block is looked for (s)."""
_END = 1 - 2.0**-15
"""Magnitude, of full scale, at which a sample is at the end of the range."""
_SAME = 1e-9
_HEARD = 0.7
"""Correlation of the monitor with the waveform from which it is heard."""
_CLEAR, _EXACT = 2.0, 1e-3
"""What the declared latency may leave unexplained of what was heard: a multiple of what the best one leaves,
and a share."""
_SHIFT = 16
"""Frames by which it may differ: an amplifier in between is late by a few, and buffers by more."""
_MOST_LATE = 0.5
"""Longest latency that is looked for (s)."""


class SoundCardDaq(Daq):
    """See `Daq`. An AC-coupled output holds no voltage: a waveform with a mean is refused."""

    taped = True

    class Settings(SoundSettings):
        """The `[daq]` table of a rig file."""

    def __init__(self, settings: Settings, clock: Clock, audio: Audio) -> None:
        """Look the device up; nothing is opened. Raises ConfigurationError and InstrumentError."""
        self.audio = audio
        self._settings, self.clock = settings, clock
        self._stream_open: SoundCardStream | None = None
        sides = {
            "input": max(c.input for c in settings.channels.values()),
            "output": max((o.output for o in settings.outputs.values()), default=0),
        }
        for kind, wanted in sides.items():
            if not wanted:
                continue
            self.identity, has = found(audio, settings.device, kind, "[daq]")
            if has < wanted:
                raise ConfigurationError(
                    f"{self.identity} has {has} {kind}s, and [daq] names {kind} {wanted}: correct its "
                    "number, or 'device'."
                )
        self.declared = (
            f"{self.identity}: are its volume and input gains where volts_per_full_scale was measured, and "
            "are its effects, its microphone boost and other programs' sounds off?"
        )

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: the device, with both of its sides."""
        device = settings.device or "by default"
        return (f"sound input {device}", f"sound output {device}")

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Find the device. Raises ConfigurationError without sounddevice, InstrumentError."""
        line = taped_line()
        return cls(settings, clock, on_tape(line, None if line.playing else load()))

    def response(self, channel: str, frequencies: FloatArray) -> ComplexArray:
        """See `Daq.response`: the input's AC coupling."""
        return high_pass(frequencies, self._settings.channels[channel].high_pass_hz)

    def filtered(self, channel: str) -> bool:
        """See `Daq.filtered`: converters of audio have a filter each."""
        return True

    def output_response(self, output: str, frequencies: FloatArray) -> ComplexArray:
        """See `Daq.output_response`: the output's AC coupling."""
        return high_pass(frequencies, self._settings.outputs[output].high_pass_hz)

    def _stream(self, request: StreamRequest) -> Stream:
        self._refuse(request)
        self._stream_open = SoundCardStream(self, request)
        return self._stream_open

    def zero(self) -> None:
        """See `Daq.zero`: without a stream, the card puts out nothing."""
        if self._stream_open is not None:
            self._stream_open.mute()

    def close(self) -> None:
        """See `Daq.close`."""
        if self._stream_open is not None:
            self._stream_open.close()

    # For streams

    def _refuse(self, request: StreamRequest) -> None:
        outputs = self._settings.outputs
        request.refuse_unknown(self._settings.channels, outputs)
        own, rate_hz = self._settings.rate_hz, request.rate_hz
        if not abs(rate_hz - own) <= _SAME * own:
            raise ConfigurationError(
                f"{self.identity} runs at {own:g} samples/s ('rate_hz' in [daq]), and {rate_hz:g} were asked "
                f"for: write rate_hz = {own:g} at the top of the rig file for recordings, and in [table] for "
                "drives."
            )
        for name, volts in request.play.items():
            most = min(outputs[name].highest, outputs[name].volts_per_full_scale)
            if not np.all(np.isfinite(volts)) or np.abs(volts).max(initial=0.0) > most:
                raise LimitError(
                    f"The waveform for {name!r} leaves the output's range of +-{most:g} V ('highest' and "
                    "'volts_per_full_scale' in [daq]) or is not finite."
                )
            if outputs[name].high_pass_hz:
                refuse_mean(volts)


class SoundCardStream(Stream):
    """See `Stream`."""

    def __init__(self, daq: SoundCardDaq, request: StreamRequest) -> None:
        settings, channels, play = daq._settings, request.channels, request.play
        self.channels, self.rate_hz = channels, settings.rate_hz
        self.delays = np.zeros(len(channels))
        self.full_scale = np.array([settings.channels[name].volts_per_full_scale for name in channels])
        self._daq, self._request = daq, request
        self._rows = [settings.channels[name].input - 1 for name in channels]
        lead = round(LEAD * self.rate_hz)
        self._skip = lead + ((settings.latency or 0) if play else 0)
        self._monitor = (
            _Monitor(daq, next(iter(play.values()))) if settings.monitor and len(play) == 1 else None
        )
        inputs = max(c.input for c in settings.channels.values())
        outputs = max((o.output for o in settings.outputs.values()), default=0)
        frames = _frames(settings, play, outputs, lead) if play else np.zeros((0, 0), dtype=np.float32)
        self._state = _Callback(daq.audio, frames, self._skip, inputs)
        self._open, self._zeroed = True, False
        opened = daq.audio.Stream if play else daq.audio.InputStream
        self._stream: AudioStream | None = None
        try:
            self._stream = opened(
                samplerate=self.rate_hz,
                device=None if settings.device == "" else settings.device,
                channels=(inputs, outputs) if play else inputs,
                dtype="float32",
                latency=settings.buffer,
                callback=self._state.duplex if play else self._state.record,
            )
            self._stream.start()
        except (daq.audio.PortAudioError, ValueError) as error:
            self.close()
            raise InstrumentError(
                f"{daq.identity} does not start at {self.rate_hz:g} samples/s "
                f"({' '.join(str(error).split())}): close other programs that use it, or set 'rate_hz' in "
                "[daq] to what it runs at."
            ) from None

    def __iter__(self) -> Iterator[Block]:
        """See `Stream.__iter__`."""
        self._take(self._skip)
        for first, count in self._request.blocks():
            if not (self._open or self._zeroed):
                return
            taken = self._take(count)
            if taken.shape[1] < count:
                return  # it was closed
            if self._monitor is not None:
                self._monitor.heard(taken)
            volts = taken[self._rows] * self.full_scale[:, np.newaxis]
            yield Block(first, volts, np.any(np.abs(taken[self._rows]) >= _END, axis=1))

    def close(self) -> None:
        """See `Stream.close`: PortAudio drops what waits to be played."""
        self._open = False
        stream, self._stream = self._stream, None
        if stream is not None:
            try:
                stream.close(ignore_errors=False)
            except self._daq.audio.PortAudioError as error:
                raise InstrumentError(
                    f"{self._daq.identity} was not told to stop ({' '.join(str(error).split())}): unplug it."
                ) from None

    def mute(self) -> None:
        """Put out zero from now on; a waveform that is being played ends at once."""
        if self._state.mute() and self._open:
            self._zeroed = True
            self.close()

    def _take(self, count: int) -> FloatArray:
        """Wait for the next `count` frames, (inputs, count) of full scale."""
        clock, state = self._daq.clock, self._state
        deadline = clock.now() + count / self.rate_hz + _LATE
        while self._open and state.waiting < count:
            active = self._stream is not None and self._stream.active
            if state.problem is not None:
                raise InstrumentError(f"{self._daq.identity} {state.problem}")
            if state.waiting >= count:
                break
            if not active or clock.now() > deadline:
                why = "delivered no more samples" if active else "stopped by itself"
                raise InstrumentError(
                    f"{self._daq.identity} {why} at frame {state.taken + state.waiting}: is it still "
                    "plugged in, and do other programs use it?"
                )
            clock.sleep(max((count - state.waiting) / self.rate_hz, _POLL))
        if self._zeroed:
            raise InstrumentError(
                f"{self._daq.identity} was set to zero by this program while it played: the waveform was not "
                "played whole, and what was measured is not used."
            )
        if state.problem is not None:
            raise InstrumentError(f"{self._daq.identity} {state.problem}")
        return state.take(count)


def _frames(settings: SoundCardDaq.Settings, play: Mapping[str, FloatArray], outputs: int, lead: int) -> Any:
    """What the outputs get, (frames, outputs) of full scale, after a silence of `lead` frames."""
    length = max(len(volts) for volts in play.values())
    frames = np.zeros((lead + length, outputs), dtype=np.float32)
    for name, volts in play.items():
        output = settings.outputs[name]
        frames[lead:, output.output - 1] = volts / output.volts_per_full_scale
    return frames


class _Monitor:
    """Compares what an input hears of a play with its waveform: the latency must be the declared one."""

    def __init__(self, daq: SoundCardDaq, wave: FloatArray) -> None:
        assert daq._settings.monitor is not None
        self._daq, self._wave = daq, wave
        self._row = daq._settings.channels[daq._settings.monitor].input - 1
        self._heard: list[FloatArray] = []
        self._count = 0

    def heard(self, taken: FloatArray) -> None:
        """Take (inputs, samples). Raises InstrumentError when the whole waveform was heard elsewhere."""
        if self._count < len(self._wave):
            self._heard.append(taken[self._row])
            self._count += taken.shape[1]
            if self._count >= len(self._wave):
                self._compare(np.concatenate(self._heard))

    def _compare(self, heard: FloatArray) -> None:
        rate_hz = self._daq._settings.rate_hz
        most = min(round(_MOST_LATE * rate_hz), len(self._wave) // 2)
        size = fast_length(len(heard) + len(self._wave))
        spectra = [np.fft.rfft(signal - signal.mean(), size) for signal in (heard, self._wave)]
        alike = np.abs(np.fft.irfft(spectra[0] * np.conj(spectra[1]), size))
        scale = float(np.linalg.norm(heard - heard.mean()) * np.linalg.norm(self._wave - self._wave.mean()))
        if not scale:
            return
        lags = np.arange(-most, most + 1)
        near = alike[lags] / scale
        best = int(near.argmax())
        # Where the output is not connected, nothing is heard, and nothing can be said. A tone is alike again
        # after each period, and less so: what it leaves unexplained is compared.
        left = 1 - np.array([near[best], near[np.abs(lags) <= _SHIFT].max(initial=0.0)]) ** 2
        if near[best] >= _HEARD and left[1] > _CLEAR * left[0] + _EXACT:
            settings = self._daq._settings
            raise InstrumentError(
                f"{self._daq.identity} played with a latency of {(settings.latency or 0) + lags[best]} "
                f"frames, and [daq] says {settings.latency}: what was measured is not used. Use a driver "
                "whose latency stays (ASIO, WASAPI exclusive, ALSA hw), or measure it anew by `haploop "
                "doctor --loop`."
            )


class _Callback:
    """State of one stream, which PortAudio's thread calls for frames."""

    def __init__(self, audio: Audio, frames: Any, skip: int, inputs: int) -> None:
        """`frames` are what the outputs get, without a row where none plays; `skip` come before sample 0."""
        self.problem: str | None = None
        """Why the samples cannot be used, as the end of a sentence; None as long as they can."""
        self.taken = 0
        self._abort = audio.CallbackAbort
        self._frames, self._skip = frames, skip
        self._next = 0
        self._came = 0
        self._muted = False
        self._inbox: Inbox[Any] = Inbox()
        self._left: Any = np.zeros((0, inputs), dtype=np.float32)

    @property
    def waiting(self) -> int:
        """Number of frames that came and were not taken."""
        return self._came - self.taken

    def duplex(self, indata: Any, outdata: Any, frames: int, time: object, status: Any) -> None:
        """Take `indata` and fill `outdata`, (frames, channels) both."""
        self._note(status, frames)
        outdata[:] = 0
        if not self._muted:
            part = self._frames[self._next : self._next + frames]
            outdata[: len(part)] = part
            outdata[len(part) :] = self._frames[-1]
        self._next += frames
        self._keep(indata)

    def record(self, indata: Any, frames: int, time: object, status: Any) -> None:
        """Take `indata`, (frames, channels)."""
        self._note(status, frames)
        self._keep(indata)

    def take(self, count: int) -> FloatArray:
        """Return the next `count` frames, (channels, count); they have come, or the stream is closed."""
        parts = [self._left]
        while sum(map(len, parts)) < count and len(self._inbox):
            parts.append(self._inbox.take())
        frames = np.concatenate(parts)
        self._left = frames[count:]
        self.taken += len(frames) - len(self._left)
        return np.asarray(frames[:count].T, dtype=np.float64)

    def mute(self) -> bool:
        """Put out zero from now on. Returns True when the waveform was not played whole."""
        # Frames that were handed over wait in buffers: they are out once an input has heard them.
        cut = not self._muted and self._came < len(self._frames) + self._skip and len(self._frames) > 0
        self._muted = True
        return cut

    def _note(self, status: Any, frames: int) -> None:
        """Note what PortAudio says of its buffers, but for the silence before a recording."""
        if self.problem is not None or (not len(self._frames) and self._came + frames <= self._skip):
            return
        if status.input_overflow or status.input_underflow:
            what = "lost samples of its inputs (an overrun)"
        elif len(self._frames) and (status.output_underflow or status.output_overflow):
            what = "ran out of samples to play (an underrun)"
        else:
            return
        self.problem = (
            f"{what} near frame {self._came}: what was measured is not used. Close other programs, leave "
            "'buffer' at \"high\", and use a driver without a mixer (ASIO, WASAPI exclusive, ALSA hw, JACK)."
        )
        raise self._abort

    def _keep(self, indata: Any) -> None:
        self._inbox.put(indata.copy())
        self._came += len(indata)
