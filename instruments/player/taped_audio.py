"""PortAudio on a line that a tape listens to or answers.

PortAudio calls back: so the tape holds, as the answer to a question that a stream asks, how many frames
PortAudio wanted and with which flags. A player asks for as many, and compares what it gets.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..tape import Failure, Handle, TapedLine

__all__ = ["TapedAudio"]


class _PortAudioError(Exception):
    """Stands for sounddevice's error where it is not installed."""


class _Stop(Exception):  # noqa: N818  as sounddevice calls it
    """Stands for sounddevice's CallbackStop."""


class _Abort(Exception):  # noqa: N818
    """Stands for sounddevice's CallbackAbort."""


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

    @property
    def OutputStream(self) -> Callable[..., Any]:  # noqa: N802  as sounddevice calls it
        """See `Audio.OutputStream`."""
        return self._opened

    def _opened(
        self,
        *,
        callback: Callable[[Any, int, object, Any], None],
        finished_callback: Callable[[], None],
        **how: Any,
    ) -> Any:
        calls = _Calls(self._line, callback, finished_callback, (self.CallbackStop, self.CallbackAbort))
        stream = self._line.call(
            "OutputStream",
            lambda: self._audio.OutputStream(callback=calls.fill, finished_callback=calls.finish, **how),
            how,
            failures=self._failures,
        )
        calls.stream = stream
        return _Stream(self._line, stream, calls, int(how["channels"]), self._failures)


class _Calls:
    """What PortAudio calls, through the line."""

    def __init__(
        self,
        line: TapedLine,
        fill: Callable[[Any, int, object, Any], None],
        finish: Callable[[], None],
        ends: tuple[type[Exception], ...],
    ) -> None:
        self._line, self._fill, self._finish, self._ends = line, fill, finish, ends
        self.stream: Any = None
        """What calls; PortAudio's, or what stands for it."""

    def fill(self, outdata: Any, frames: int, time: object, status: Any) -> None:
        """Fill `outdata` and note what was asked for and given."""
        asked = [frames, bool(status.output_underflow)]
        self._line.call("wanted", lambda: asked, self.stream, order=self)
        try:
            self._fill(outdata, frames, time, status)
        finally:
            self._line.call("filled", lambda: None, _digest(outdata), order=self)

    def finish(self) -> None:
        """Note that the last sample has come out."""
        self._line.call("wanted", lambda: [0, False], self.stream, order=self)
        self._finish()

    def play(self, channels: int) -> None:
        """Ask for the frames that the tape says were asked for."""
        while True:
            wanted = self._line.call("wanted", lambda: None, self.stream, order=self)
            if wanted is None:  # it was stopped
                return
            frames, underflow = wanted
            if not frames:
                self._finish()
                return
            outdata = np.zeros((frames, channels), np.float32)
            try:
                self._fill(outdata, frames, None, SimpleNamespace(output_underflow=underflow))
            except self._ends:
                pass
            finally:
                self._line.call("filled", lambda: None, _digest(outdata), order=self)


class _Stream:
    """See `AudioStream`."""

    def __init__(
        self, line: TapedLine, stream: Any, calls: _Calls, channels: int, failures: tuple[Failure, ...]
    ) -> None:
        self._line, self._stream, self._calls = line, stream, calls
        self._channels, self._failures = channels, failures

    def start(self) -> None:
        """See `AudioStream.start`."""
        self._line.call("start", self._started, failures=self._failures)
        if isinstance(self._stream, Handle):
            self._calls.play(self._channels)  # at once: a tape takes no time

    def close(self, ignore_errors: bool) -> None:
        """See `AudioStream.close`."""
        self._line.call("close", lambda: self._closed(ignore_errors), failures=self._failures)

    def _started(self) -> None:
        self._stream.start()

    def _closed(self, ignore_errors: bool) -> None:
        self._stream.close(ignore_errors=ignore_errors)


def _digest(outdata: Any) -> str:
    return hashlib.sha256(np.ascontiguousarray(outdata).tobytes()).hexdigest()[:16]
