"""Monitor a play: a block that trips stops it and locks out the rig; and proof of the amplifier's gain."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, InstrumentError
from ...base.progress import Progress, silent
from ...base.signals import deliver
from ..daq import Block, Capture
from ..limits import Limits
from ..safety import AbortMonitor, Limiter, Lockouts, Renewal, combined, trip
from .roles import Instruments


class PlayRequest:
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
        self, take: PlayRequest, samples: int
    ) -> Iterator[tuple[tuple[str, ...], Callable[[Block], None]]]:
        """Yield the channels to record, with the monitored ones, and the function to call on every block.

        The function keeps the relay renewed while `renewed` lasts, tests the block, reports progress and
        delivers stop signals, which are otherwise held back from before the first volt until the safe state.
        A block that trips raises InstrumentError; the rig is locked out once the safe state has been tried.
        """
        rig = self._rig
        laser = rig.vibrometer if rig.has("vibrometer") else None
        limits = combined(self._limiter.kept.of(len(take.patches)))
        if clause := rig.file.abort.too_high(max(limits.max, -limits.min)):
            raise ConfigurationError(f"The rig {rig.name!r} plays nothing: [abort] {clause}.")
        abort_monitor = AbortMonitor(
            rig.file.abort, rig.sensors, laser, limits, rate_hz=rig.table.rate_hz, warm=self._limiter.warm
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


# Proof of the amplifier's gain before the first play of a session, at a volt and by the drive monitor.
#
# A gain in the rig file that is a tenth of the true one would put ten times the drive on the patch until the
# abort monitor stops the play, two blocks later. One volt shows it first. A gain and a divider that are wrong
# by the same factor agree, and prove nothing: a gain that is not the product's own asks for its source, and
# doctor says where both differ by one factor.

UNPROVED = (
    "The gain of the amplifier cannot be proved on this rig, because it has no [sensors.drive]: nothing "
    "shows what a patch really gets, and the rig cannot be calibrated."
)
"""Sentence for a rig without a drive monitor."""

_LEVEL = 1.0
"""Amplitude (V at the patch)."""
TOO_MUCH = 1.25
"""Volts measured per volt asked for at which the gain is not what the rig file says. Amplifiers of one type
differ by 1 % (docs/hardware.md, "Amplifier"), and a volt of hum on the monitor adds less than 0.15 V."""
SHOWN = 0.5
"""Volts measured per volt asked for below which a monitor counts as dead: it could show no volt too many."""
HZ = 225.0
"""Frequency, as far from the harmonics of 50 and 60 Hz as the window can tell."""
_SECONDS, _RAMP = 0.07, 0.01
_WINDOW = 0.04
"""Length over which the amplitude is measured (s): whole periods of the tone and of 50 Hz."""


class UnshownError(InstrumentError):
    """The monitor of a patch does not show the volts of the proof, or of a play, so nothing else was played.

    `share` is what it showed of them, and `elsewhere` the monitors that did show them.
    """

    def __init__(
        self, patch: str, share: float, elsewhere: tuple[str, ...], when: str = "the gain was proved"
    ) -> None:
        self.share, self.elsewhere = share, elsewhere
        found = f", and {' and '.join(elsewhere)} shows it" if elsewhere else ""
        super().__init__(
            f"The drive monitor shows {share:.2g} V for each volt that patch {patch} was to get when {when}"
            f"{found}, so nothing else was played: check the amplifier, the contact, and the "
            "monitor's cable and scale."
        )


def level_of(limits: Limits) -> float:
    """Amplitude of the proof (V at the patch)."""
    return min(_LEVEL, limits.peak / 4)


def tone(level: float, rate_hz: float) -> FloatArray:
    """The drive of the proof: (samples,) V at the patch."""
    t = np.arange(round(_SECONDS * rate_hz)) / rate_hz
    ramp = np.clip(np.minimum(t, t[-1] - t) / _RAMP, 0.0, 1.0)
    return np.asarray(level * ramp * np.sin(2 * np.pi * HZ * t))


def loudest(volts: FloatArray, rate_hz: float) -> float:
    """Amplitude of the tone in (samples,) V where it is loudest, without hum and offset."""
    count = min(round(_WINDOW * rate_hz), len(volts))
    turned = (volts - np.median(volts)) * np.exp(-2j * np.pi * HZ * np.arange(len(volts)) / rate_hz)
    total = np.cumsum(np.concatenate([[0.0], turned]))
    return float(2 * np.abs(total[count:] - total[:-count]).max() / count)
