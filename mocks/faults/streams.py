"""Faults of streams that other programs send."""

from __future__ import annotations

import numpy as np

from ..plant import OnStreams, TimedFault


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
