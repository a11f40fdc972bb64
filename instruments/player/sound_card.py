"""A sound card's line output beside a DAQ of another make, the paper's signal path.

The output is AC-coupled, and its volume is the operating system's, which cannot be read here
(docs/hardware.md, "Sound card"). So volts at full scale are declared, from a loop-back calibration; a
waveform is refused rather than clipped; and an underflow is a failed play, never a silent gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from ...base.arrays import ComplexArray, FloatArray
from ...base.bounded import Number, Positive, Strict
from ...base.clock import Clock
from ...base.errors import InstrumentError, LimitError
from ...base.filters import fast_length
from ..portaudio import LEAD, Audio, AudioStream, found, high_pass, load, on_tape, refuse_mean
from ..tape import taped_line
from .role import Player

_GUARD = 0.02
"""Silence after a waveform (s), so that resampling rings there and not into the start."""


class SoundCard(Player):
    """See `Player`. Resamples to the card's rate by FFT, which is exact for band-limited drives."""

    taped = True

    class Settings(Strict):
        """The `[player]` table of a rig file."""

        output: str
        """Name of the amplifier input that its output is wired to."""
        volts_per_full_scale: Positive
        """Output at digital full scale (V peak): measure it, and then keep the volume."""
        highest: Positive = 1.0
        """Largest output allowed (V peak): 50 V at a patch behind a gain of 50."""
        device: Number | str = ""
        """Number or part of the name, as sounddevice lists it; empty for the system's default."""
        channel: Literal[1, 2] = 1
        """Left or right; the other one stays silent."""
        rate_hz: Positive = 48_000.0
        """Native sample rate (Hz); any other rate is resampled by an unknown stage."""
        high_pass_hz: Annotated[float, Field(strict=True, ge=0, le=20)] = 5.0
        """Corner of its AC coupling; an estimate (docs/hardware.md, "Sound card")."""
        max_latency: Annotated[float, Field(strict=True, gt=0, le=5)] = 0.5
        """Longest time until the first sample comes out (s)."""

    def __init__(self, settings: Settings, clock: Clock, audio: Audio) -> None:
        """Query the device's name; nothing is opened. Raises InstrumentError."""
        self.audio = audio
        self.output = settings.output
        self.max_latency = settings.max_latency + LEAD
        self._settings = settings
        self._device = None if settings.device == "" else settings.device
        self._stream: AudioStream | None = None
        self.identity, _ = found(audio, settings.device, "output", "[player]")
        self.declared = (
            f"{self.identity}: is its volume where full scale was measured to be "
            f"{settings.volts_per_full_scale:g} V peak, and are its effects and other programs' sounds off?"
        )

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: the output."""
        return (f"sound output {settings.device or 'by default'}",)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Find the device. Raises ConfigurationError without sounddevice, InstrumentError."""
        line = taped_line()
        return cls(settings, clock, on_tape(line, None if line.playing else load()))

    @contextmanager
    def _play(self, volts: FloatArray, rate_hz: float) -> Iterator[None]:
        samples = self._samples(volts, rate_hz)
        self.stop()
        playing = _Playing(samples, self._settings.channel - 1, self.audio)
        try:
            self._stream = self.audio.OutputStream(
                samplerate=self._settings.rate_hz,
                device=self._device,
                channels=2,
                dtype="float32",
                latency="high",
                callback=playing.fill,
                finished_callback=playing.finish,
            )
            self._stream.start()
        except (self.audio.PortAudioError, ValueError) as error:
            self.stop()
            raise InstrumentError(
                f"{self.identity} cannot play at {self._settings.rate_hz:g} samples/s ({error}): close other "
                "programs that use it, or set 'rate_hz' in [player] to what it runs at."
            ) from None
        try:
            yield
            problem = playing.problem
        finally:
            self.stop()
        if problem:
            raise InstrumentError(f"{self.identity} {problem}; what was measured is not used.")

    def rendered(self, volts: FloatArray, rate_hz: float) -> tuple[FloatArray, float]:
        """See `Player.rendered`; without the AC coupling, whose sag the drive monitor measures."""
        full_scale, own_hz = self._settings.volts_per_full_scale, self._settings.rate_hz
        return full_scale * self._samples(volts, rate_hz), own_hz

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """See `Player.response`: one real zero at 0 Hz, one real pole."""
        return high_pass(frequencies, self._settings.high_pass_hz)

    def stop(self) -> None:
        """See `Player.stop`."""
        stream, self._stream = self._stream, None
        if stream is None:
            return
        try:
            stream.close(ignore_errors=False)
        except self.audio.PortAudioError as error:
            raise InstrumentError(f"{self.identity} was not told to stop ({error}): unplug it.") from None

    def close(self) -> None:
        """See `Player.close`."""
        self.stop()

    def _samples(self, volts: FloatArray, rate_hz: float) -> FloatArray:
        """Resample to the card's rate and scale to full scale, (samples,)."""
        settings = self._settings
        if not len(volts) or not np.all(np.isfinite(volts)):
            raise LimitError(f"A waveform for {self.identity} must have samples, and each must be finite.")
        most = min(settings.highest, settings.volts_per_full_scale)
        resampled = at_rate(volts, rate_hz, settings.rate_hz)
        peak = max(float(np.abs(volts).max()), float(np.abs(resampled).max()))
        # One part in 10^6 allows for rounding in the resampling.
        if peak > most * (1 + 1e-6):
            raise LimitError(
                f"A waveform of {peak:.4g} V peak was refused: {self.identity} may put out {most:g} V "
                "('highest' and 'volts_per_full_scale' in [player])."
            )
        refuse_mean(volts)
        lead = np.zeros(round(LEAD * settings.rate_hz))
        scaled = np.clip(resampled / settings.volts_per_full_scale, -1.0, 1.0)
        return np.concatenate([lead, scaled])


class _Playing:
    """State of one play; PortAudio's thread calls `fill` and `finish`."""

    def __init__(self, samples: FloatArray, channel: int, audio: Audio) -> None:
        self._samples = samples.astype(np.float32)
        self._channel = channel
        self._audio = audio
        self._next = 0
        self._underflow = False
        self._finished = False

    @property
    def problem(self) -> str | None:
        """Reason why the play was not complete; None when it was."""
        if self._underflow:
            return "ran out of samples (an underflow): close other programs, and try again"
        if self._next < len(self._samples) or not self._finished:
            done = min(self._next / len(self._samples), 1.0)
            return (
                f"had not played to the end when recording ended (it had asked for {done:.0%}): is it still "
                "plugged in, and is 'max_latency' in [player] long enough?"
            )
        return None

    def fill(self, outdata: Any, frames: int, time: object, status: Any) -> None:
        """Fill `outdata`, (frames, channels), with the next samples for PortAudio."""
        outdata[:] = 0
        if status.output_underflow:
            self._underflow = True
            raise self._audio.CallbackAbort
        part = self._samples[self._next : self._next + frames]
        outdata[: len(part), self._channel] = part
        self._next += frames
        if self._next >= len(self._samples):
            raise self._audio.CallbackStop

    def finish(self) -> None:
        """Note that PortAudio has put the last sample out."""
        self._finished = True


def at_rate(volts: FloatArray, rate_hz: float, wanted_hz: float) -> FloatArray:
    """Resample a waveform ((samples,), at rest at both ends) by FFT; the result is `_GUARD` s longer."""
    ratio = Fraction(wanted_hz / rate_hz).limit_denominator(10_000)
    blocks = -(-(len(volts) + round(_GUARD * rate_hz)) // ratio.denominator)
    blocks = fast_length(blocks)
    before, after = blocks * ratio.denominator, blocks * ratio.numerator
    spectrum = np.fft.rfft(volts, before)[: after // 2 + 1]
    longer = np.fft.irfft(spectrum, after) * (after / before)
    return np.asarray(longer[: round((len(volts) / rate_hz + _GUARD) * wanted_hz)])
