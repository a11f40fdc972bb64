"""Monitor a play: each block is tested, and a block that trips stops the play and locks out the rig."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ...base.errors import ConfigurationError
from ...base.progress import Progress, silent
from ...base.signals import deliver
from ..daq import Block, Capture
from ..safety import AbortMonitor, Limiter, Lockouts, Renewal, combined, trip
from .ratings import ratings
from .roles import Instruments


class Take:
    """The patches of a play, what is recorded meanwhile and for how long (s) after it, and who is told."""

    def __init__(
        self,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> None:
        """Raises ConfigurationError for a tail that cannot be recorded."""
        if not 0 <= tail < np.inf:
            raise ConfigurationError(f"Recording can go on for 0 s or more after a drive, not for {tail} s.")
        self.patches, self.channels = tuple(dict.fromkeys(patches)), tuple(channels)
        self.tail, self.progress = tail, progress

    def samples_after(self, rate_hz: float) -> int:
        """Samples that are recorded after a drive."""
        return max(1, round(self.tail * rate_hz))

    def only(self, capture: Capture, samples: int) -> Capture:
        """Reduce a capture to the requested channels and at most `samples` samples."""
        rows = [capture.channels.index(channel) for channel in self.channels]
        return replace(
            capture,
            channels=self.channels,
            volts=capture.volts[rows, :samples],
            delays=capture.delays[rows],
            overload=capture.overload[rows],
        )


class Monitoring:
    """Runs the abort monitor in each play of a rig. A trip locks it out.

    `live_run` begins a run for live views, as `Rig.live_run`.
    """

    def __init__(
        self,
        rig: Instruments,
        lockouts: Lockouts,
        limiter: Limiter,
        live_run: Callable[[str, str, Collection[str], float], Callable[[Block], None]],
    ) -> None:
        self._rig = rig
        self._lockouts = lockouts
        self._limiter = limiter
        self._live_run = live_run
        self._renewal: Renewal | None = None

    @contextmanager
    def renewed(self) -> Iterator[None]:
        """Renew the relay's dead-man while blocks come. See `Renewal`."""
        self._renewal = Renewal(self._rig.relay, self._rig.clock)
        with self._renewal.running():
            yield

    @contextmanager
    def monitored(
        self, take: Take, samples: int
    ) -> Iterator[tuple[tuple[str, ...], Callable[[Block], None]]]:
        """Yield the channels to record, with the monitored ones, and the function to call on every block.

        The function keeps the relay renewed while `renewed` lasts, tests the block, reports progress and
        delivers stop signals, which are otherwise held back from before the first volt until the safe state.
        A block that trips raises InstrumentError; the rig is locked out once the safe state has been tried.
        """
        rig = self._rig
        laser = rig.vibrometer if rig.has("vibrometer") else None
        limits = combined(ratings(rig, len(take.patches)))
        if clause := rig.file.abort.too_high(max(limits.max, -limits.min)):
            raise ConfigurationError(f"The rig {rig.name!r} plays nothing: [abort] {clause}.")
        abort_monitor = AbortMonitor(
            rig.file.abort,
            rig.sensors,
            laser,
            limits,
            rate_hz=rig.table.rate_hz,
            warm=self._limiter.warm,
        )
        recorded = tuple(dict.fromkeys([*take.channels, *abort_monitor.channels]))
        into, total = f"patch {', '.join(sorted(take.patches))}", samples / rig.table.rate_hz
        publish = self._live_run("play", into, recorded, rig.table.rate_hz)

        def each(block: Block) -> None:
            if self._renewal is not None:
                self._renewal.alive()
            abort_monitor.check(block, recorded)
            publish(block)
            take.progress(f"Play into {into}", min(block.end / rig.table.rate_hz, total), total, "s")
            deliver()

        try:
            yield recorded, each
        finally:
            if abort_monitor.tripped is not None:
                trip(self._lockouts, abort_monitor, recorded, rig.table.rate_hz)
