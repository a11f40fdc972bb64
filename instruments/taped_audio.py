"""PortAudio on a line that a tape listens to or answers.

PortAudio calls back: so the tape holds, as the answer to a question that a stream asks, how many frames
PortAudio wanted or brought, and with which flags. A player asks for as many, all at once when the stream is
started, and compares what it gets to put out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from .tape import Failure, Handle, TapedLine


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
