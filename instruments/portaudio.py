"""Sound cards through PortAudio (optional: sounddevice), also on a tape: what player and DAQ share.

A card's volume is the operating system's, which cannot be read here (docs/hardware.md, "Sound card"): volts
at full scale are declared, from a loop-back calibration, and a person confirms that the volume is still the
same.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from ..base.arrays import ComplexArray, FloatArray
from ..base.entry_points import optional
from ..base.errors import ConfigurationError, InstrumentError, LimitError
from .tape import Failure, Handle, TapedLine

LEAD = 0.05
"""Silence before a waveform (s), in which a sleeping card unmutes (estimate)."""
_MEAN = 0.01
"""Largest mean over the peak: an AC-coupled output removes the mean, as a slow sag."""


class AudioStream(Protocol):
    """The used part of a stream of `sounddevice`."""

    @property
    def active(self) -> bool:
        """True while it calls back for samples."""

    def start(self) -> object:
        """Start calling back for samples."""

    def close(self, ignore_errors: bool) -> object:
        """Stop at once, drop waiting samples, and release the device."""


class Audio(Protocol):
    """The used part of the module `sounddevice`, which the twin replaces."""

    CallbackStop: type[Exception]
    CallbackAbort: type[Exception]
    PortAudioError: type[Exception]

    @property
    def OutputStream(self) -> Callable[..., AudioStream]:  # noqa: N802  as sounddevice calls it
        """Opens a device's outputs; its keyword arguments are the driver's own."""

    @property
    def InputStream(self) -> Callable[..., AudioStream]:  # noqa: N802
        """Opens a device's inputs."""

    @property
    def Stream(self) -> Callable[..., AudioStream]:  # noqa: N802
        """Opens inputs and outputs together, in one callback."""

    def query_devices(self, device: int | str | None, kind: str) -> Any:
        """Return the device's name and capabilities, as a mapping."""


def load() -> Audio:
    """Return the module `sounddevice`. Raises ConfigurationError without it, or without PortAudio."""
    try:
        audio: Audio = optional("sounddevice", "sound", "A sound card")
    except OSError as error:
        # Without PortAudio itself, importing sounddevice is an OSError.
        raise ConfigurationError(
            f"A sound card needs PortAudio, which does not load ({error}): install the distribution's "
            "PortAudio package (Debian: libportaudio2), or sounddevice anew."
        ) from None
    return audio


def found(audio: Audio, device: int | str, kind: str, table: str) -> tuple[str, int]:
    """Return the name of a device and its number of channels of a kind, "input" or "output".

    Raises InstrumentError, which names the rig file's `table`.
    """
    try:
        known = audio.query_devices(None if device == "" else device, kind)
        return str(known["name"]), int(known[f"max_{kind}_channels"])
    except (audio.PortAudioError, ValueError) as error:
        told = " ".join(str(error).split())
        raise InstrumentError(
            f"There is no sound {kind} {device or 'by default'!r} ({told}): plug the card in, "
            f"or set 'device' in {table} to one that `python -m sounddevice` lists."
        ) from None


def high_pass(frequencies: FloatArray, corner_hz: float) -> ComplexArray:
    """Response of an AC coupling at `frequencies` (Hz): a zero at 0 Hz and a pole; 1 with a corner of 0."""
    if not corner_hz:
        return np.ones(len(frequencies), dtype=np.complex128)
    f = 1j * frequencies
    return np.asarray(f / (f + corner_hz))


def refuse_mean(volts: FloatArray) -> None:
    """Raise LimitError for a waveform that an AC-coupled output does not put out as it is."""
    peak, mean = float(np.abs(volts).max(initial=0.0)), float(volts.mean()) if len(volts) else 0.0
    if abs(mean) > _MEAN * peak:
        raise LimitError(
            f"A waveform with a mean of {mean:.2g} V at a peak of {peak:.2g} V was refused: a sound "
            "card's output is AC-coupled, so take the mean off."
        )


# PortAudio on a line that a tape listens to or answers.
#
# PortAudio calls back: so the tape holds, as the answer to a question that a stream asks, how many frames
# PortAudio wanted or brought, and with which flags. A player asks for as many, all at once when the stream is
# started, and compares what it gets to put out.


class _PortAudioError(Exception):
    """Stands for sounddevice's error where it is not installed."""


class _Stop(Exception):  # noqa: N818  as sounddevice calls it
    """Stands for sounddevice's CallbackStop."""


class _Abort(Exception):  # noqa: N818
    """Stands for sounddevice's CallbackAbort."""


def on_tape(line: TapedLine, audio: Any) -> Any:
    """The module `sounddevice`, or None for a player, on a line: as it is without a tape."""
    return TapedAudio(line, audio) if line.taped else audio


class TapedAudio:
    """See `Audio`. `audio` is the module `sounddevice`; None for a player."""

    def __init__(self, line: TapedLine, audio: Any) -> None:
        self._line, self._audio = line, audio
        self.PortAudioError: type[Exception] = audio.PortAudioError if audio else _PortAudioError
        self.CallbackStop: type[Exception] = audio.CallbackStop if audio else _Stop
        self.CallbackAbort: type[Exception] = audio.CallbackAbort if audio else _Abort
        self._failures = (Failure(self.PortAudioError), Failure(ValueError))

    def query_devices(self, device: int | str | None, kind: str) -> Any:
        """See `Audio.query_devices`."""
        return self._line.call(
            "query_devices",
            lambda: dict(self._audio.query_devices(device, kind)),
            device,
            kind,
            failures=self._failures,
        )

    def OutputStream(self, **how: Any) -> _Stream:  # noqa: N802  as sounddevice calls it
        """See `Audio.OutputStream`."""
        return self._opened("OutputStream", how, (0, int(how["channels"])))

    def InputStream(self, **how: Any) -> _Stream:  # noqa: N802
        """See `Audio.InputStream`."""
        return self._opened("InputStream", how, (int(how["channels"]), 0))

    def Stream(self, **how: Any) -> _Stream:  # noqa: N802
        """See `Audio.Stream`."""
        inputs, outputs = how["channels"]
        return self._opened("Stream", how, (int(inputs), int(outputs)))

    def _opened(self, what: str, how: dict[str, Any], channels: tuple[int, int]) -> _Stream:
        callback, finished = how.pop("callback"), how.pop("finished_callback", None)
        calls = _Calls(self._line, callback, finished, (self.CallbackStop, self.CallbackAbort), channels)
        taken = {"callback": calls.fill} | ({"finished_callback": calls.finish} if finished else {})
        calls.stream = self._line.call(
            what, lambda: getattr(self._audio, what)(**taken, **how), how, failures=self._failures
        )
        return _Stream(self._line, calls, self._failures)


class _Calls:
    """What PortAudio calls, through the line. `channels` are numbers of inputs and outputs."""

    def __init__(
        self,
        line: TapedLine,
        fill: Callable[..., None],
        finish: Callable[[], None] | None,
        ends: tuple[type[Exception], ...],
        channels: tuple[int, int],
    ) -> None:
        self._line, self._fill, self._finish, self._ends = line, fill, finish, ends
        self._inputs, self._outputs = channels
        self.stream: Any = None
        """What calls: PortAudio's, or what stands for it."""

    def fill(self, *told: Any) -> None:
        """Note what was brought and asked for, and what was given. `told` is as sounddevice has it."""
        *buffers, frames, _time, status = told
        flags = {name: bool(getattr(status, name, False)) for name in _FLAGS}
        brought = np.array(buffers[0]) if self._inputs else None
        self._line.call("wanted", lambda: (int(frames), flags, brought), self.stream, order=self)
        try:
            self._fill(*told)
        finally:
            self._filled(buffers)

    def finish(self) -> None:
        """Note that the last sample has come out."""
        self._line.call("wanted", lambda: (0, {}, None), self.stream, order=self)
        if self._finish is not None:
            self._finish()

    def play(self) -> None:
        """Bring and ask for the frames that are on the tape."""
        while wanted := self._line.call("wanted", lambda: None, self.stream, order=self):
            frames, flags, brought = wanted
            if not frames:
                if self._finish is not None:
                    self._finish()
                return
            buffers = [brought] if self._inputs else []
            if self._outputs:
                buffers.append(np.zeros((frames, self._outputs), np.float32))
            try:
                self._fill(*buffers, frames, None, SimpleNamespace(**flags))
            except self._ends:
                pass
            finally:
                self._filled(buffers)

    def _filled(self, buffers: list[Any]) -> None:
        if self._outputs:
            self._line.call("filled", lambda: None, _digest(buffers[-1]), order=self)


_FLAGS = ("input_underflow", "input_overflow", "output_underflow", "output_overflow", "priming_output")


class _Stream:
    """See `AudioStream`."""

    def __init__(self, line: TapedLine, calls: _Calls, failures: tuple[Failure, ...]) -> None:
        self._line, self._calls, self._failures = line, calls, failures

    @property
    def active(self) -> bool:
        """See `AudioStream.active`: a tape has brought everything when it was started."""
        return not self._line.playing and bool(self._calls.stream.active)

    def start(self) -> None:
        """See `AudioStream.start`."""
        self._line.call("start", self._started, failures=self._failures)
        if isinstance(self._calls.stream, Handle):
            self._calls.play()

    def close(self, ignore_errors: bool) -> None:
        """See `AudioStream.close`."""
        self._line.call("close", lambda: self._closed(ignore_errors), failures=self._failures)

    def _started(self) -> None:
        self._calls.stream.start()

    def _closed(self, ignore_errors: bool) -> None:
        self._calls.stream.close(ignore_errors=ignore_errors)


def _digest(outdata: Any) -> str:
    return hashlib.sha256(np.ascontiguousarray(outdata).tobytes()).hexdigest()[:16]
