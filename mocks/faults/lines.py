"""Faults of the communication lines to instruments, and of streams that other programs send."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ..plant import OnLine, OnStreams, PerEventFault, TimedFault
from ..transport import ReplyFault


class Reply(PerEventFault, OnLine):
    """An instrument's answers are disturbed on the line. For wires only, because a twin has no line."""

    class Settings(PerEventFault.Settings):
        instrument: str
        """Role of the instrument: relay, vibrometer, ..."""
        how: Literal["silence", "delay", "drip", "garbled", "truncated", "disconnect"] = "silence"
        asked: str = ""
        """Text that a request must contain for its answer to be disturbed."""
        delay: Annotated[float, Field(strict=True, gt=0, le=60)] = 0.05
        """Delay in real time (s): before the answer with "delay", between its bytes with "drip"."""

    settings: Settings

    @property
    def line(self) -> str | None:
        return self.settings.instrument

    def answer(self, request: str, now: float) -> ReplyFault | None:
        if self.settings.asked not in request or not self.fires(now):
            return None
        return ReplyFault(self.settings.how, delay=self.settings.delay)


# Faults of streams that other programs send.


class _OfStream(TimedFault, OnStreams):
    class Settings(TimedFault.Settings):
        stream: str
        """Its name in the rig file."""

    settings: Settings

    def _acts(self, stream: str, time: float) -> bool:
        return stream == self.settings.stream and bool(self.active(np.array([time]))[0])


class StreamLost(_OfStream):
    """The sender's program ends, or was not started; later it is there again."""

    def stream_lost(self, stream: str, time: float) -> bool:
        return self._acts(stream, time)


class SamplesLost(_OfStream):
    """The sender is there, and sends nothing."""

    def samples_lost(self, stream: str, time: float) -> bool:
        return self._acts(stream, time)
