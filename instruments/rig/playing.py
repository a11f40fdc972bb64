"""Play a drive on the DAQ's outputs or on a player, or a waveform on a generator.

The order is always the same: the limiter authorises, stop signals are held back, the abort monitor is set
up, the relay connects once the limiter knows every output to be at zero, the drive plays. The safe state
follows in every case.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from ..clock import Clock
from ..daq import Block, Capture, Stream
from ..errors import ConfigurationError, InstrumentError
from ..generator import Waveform
from ..limits import Limits
from ..progress import Progress, silent
from ..safety import Limiter, exit_within
from ..signals import uninterrupted
from .alignment import align, find
from .monitoring import Monitoring
from .ratings import ratings
from .roles import Instruments

__all__ = ["Playing"]

_SLACK = 0.5
"""Time for a generator to answer its trigger and for a block to arrive (s)."""


class Playing:
    """Plays on a rig what its limiter authorises, and calls `make_safe` after each play."""

    def __init__(
        self,
        rig: Instruments,
        clock: Clock,
        limiter: Limiter,
        monitoring: Monitoring,
        make_safe: Callable[[], None],
    ) -> None:
        self._rig = rig
        self._clock = clock
        self._limiter = limiter
        self._monitoring = monitoring
        self._make_safe = make_safe

    def excite(
        self,
        drive: FloatArray,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """See `Rig.excite`."""
        rig = self._rig
        if rig.amplifier.inputs:
            return self.excite_each(dict.fromkeys(patches, drive), channels, tail, progress)
        rate_hz = rig.table.rate_hz
        _refuse_tail(tail)
        if not rig.feeds_amplifier("player"):
            return self._played({rig.amplifier.input: drive}, patches, channels, tail, progress)
        output, rendered = rig.player.output, rig.player.rendered
        permitted = self._limiter.permit(
            {output: drive}, rate_hz, frozenset(patches), rig.amplifier, self._ratings, rendered
        )
        with uninterrupted(), permitted as volts:
            count = len(drive) + max(1, round(tail * rate_hz))
            return self._excite_by_player(drive, volts[output], patches, channels, count, progress)

    def excite_each(
        self,
        drives: Mapping[str, FloatArray],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """See `Rig.excite_each`."""
        rig = self._rig
        inputs = rig.amplifier.inputs
        missing = [patch for patch in drives if patch not in inputs]
        if missing or not drives:
            raise ConfigurationError(
                f"The amplifier of the rig {rig.name!r} has no channel of its own for patch "
                f"{', '.join(missing) or '(none was named)'}: play one patch at a time, or give 'input' in "
                "[amplifier] a name for each patch."
            )
        _refuse_tail(tail)
        own = {inputs[patch]: drive for patch, drive in drives.items()}
        return self._played(own, tuple(drives), channels, tail, progress)

    def generate(
        self,
        waveform: Waveform,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """See `Rig.generate`."""
        rig = self._rig
        _refuse_tail(tail)
        if not rig.feeds_amplifier("generator"):
            raise ConfigurationError(
                f"The generator of the rig {rig.name!r} is wired to {rig.generator.output!r}, and its "
                f"amplifier's input is {rig.amplifier.input!r}: give both the same name in the rig file."
            )
        permitted = self._limiter.permit_waveform(
            rig.generator.output, waveform, _SLACK, frozenset(patches), rig.amplifier, self._ratings
        )
        with uninterrupted(), permitted as at_output:
            return self._generated(at_output, patches, channels, tail, progress)

    def _played(
        self,
        drives: Mapping[str, FloatArray],
        patches: Collection[str],
        channels: Sequence[str],
        tail: float,
        progress: Progress,
    ) -> Capture:
        """Play drives (V at the patch) on the DAQ's outputs."""
        rig = self._rig
        rate_hz = rig.table.rate_hz
        permitted = self._limiter.permit(drives, rate_hz, frozenset(patches), rig.amplifier, self._ratings)
        with uninterrupted(), permitted as volts:
            samples = len(next(iter(volts.values())))
            count = samples + max(1, round(tail * rate_hz))
            padded = {output: np.pad(v, (0, count - samples)) for output, v in volts.items()}
            with (
                self._monitoring.monitored(patches, channels, count, progress) as (recorded, each),
                self._connected(patches),
                self._streamed(recorded, count, padded) as stream,
            ):
                return _only(channels, stream.capture(each), count)

    def _excite_by_player(
        self,
        drive: FloatArray,
        volts: FloatArray,
        patches: Collection[str],
        channels: Sequence[str],
        count: int,
        progress: Progress,
    ) -> Capture:
        rig = self._rig
        rate_hz, monitor = rig.table.rate_hz, rig.drive_monitor()
        total = count + round(rig.player.max_latency * rate_hz)
        with (
            self._monitoring.monitored(patches, channels, total, progress) as (recorded, each),
            self._connected(patches),
            self._streamed(recorded, total) as stream,
            exit_within(rig.player.identity, rig.player.play(volts, rate_hz)),
        ):
            capture = stream.capture(each)
        if drive.any():
            row = recorded.index(monitor.channels[0])
            measured = monitor.to_si(capture.volts[[row]])[0]
            delay = float(capture.delays[row])
            capture = align(capture, find(measured, drive, rate_hz, delay, rig.player.response), count)
        return _only(channels, capture, count)

    def _generated(
        self,
        waveform: Waveform,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float,
        progress: Progress,
    ) -> Capture:
        """Play a waveform, in volts at the generator's output."""
        rig = self._rig
        triggered: list[float] = []
        ended = False
        total = round((waveform.duration + tail + _SLACK) * rig.table.rate_hz)
        rig.generator.configure(waveform)
        with (
            self._monitoring.monitored(patches, channels, total, progress) as (recorded, each),
            self._connected(patches),
        ):

            def follow(block: Block) -> None:
                nonlocal ended
                each(block)
                if not triggered:
                    rig.generator.trigger()
                    triggered.append(self._clock.now())
                elif not ended and self._clock.now() >= triggered[0] + waveform.duration:
                    if not rig.generator.is_on:
                        raise InstrumentError(
                            f"The {rig.generator.identity} was switched off while its waveform was played: "
                            "what was measured is not used."
                        )
                    rig.generator.off()
                    ended = True

            rig.generator.arm()
            with self._streamed(recorded, total) as stream:
                capture = _only(channels, stream.capture(follow), total)
        if not ended:
            raise InstrumentError(
                f"The waveform of the {rig.generator.identity} had not ended when recording ended: it was "
                "too late to follow its trigger. Try again, and check its cable."
            )
        return capture

    def _streamed(
        self, channels: Sequence[str], samples: int, play: Mapping[str, FloatArray] | None = None
    ) -> AbstractContextManager[Stream]:
        """Open a stream at the table's rate, in blocks of 0.1 s."""
        rig = self._rig
        rate_hz = rig.table.rate_hz
        stream = rig.daq.stream(channels, rate_hz, round(rate_hz / 10), samples, play)
        return exit_within(rig.daq.identity, stream)

    @contextmanager
    def _connected(self, patches: Collection[str]) -> Iterator[None]:
        """Connect exactly these patches to outputs at zero volts, and reach the safe state on exit.

        Raises InstrumentError for a patch that has been disconnected meanwhile, by this program too.
        """
        relay = self._rig.relay
        try:
            relay.connect(patches)
            with self._monitoring.renewed():
                yield
                opened = sorted(frozenset(patches) - relay.connected())
            if opened:
                raise InstrumentError(
                    f"The relay disconnected patch {', '.join(opened)} while its drive was played: what was "
                    "measured is not used."
                )
        finally:
            # Zero first: the relay switches without voltage, and a patch is left without charge.
            self._make_safe()

    def _ratings(self, patches: int) -> dict[str, Limits]:
        return ratings(self._rig, patches)


def _only(channels: Sequence[str], capture: Capture, samples: int) -> Capture:
    """Reduce a capture to the requested channels and at most `samples` samples."""
    rows = [capture.channels.index(channel) for channel in channels]
    return replace(
        capture,
        channels=tuple(channels),
        volts=capture.volts[rows, :samples],
        delays=capture.delays[rows],
        overload=capture.overload[rows],
    )


def _refuse_tail(tail: float) -> None:
    if not 0 <= tail < np.inf:
        raise ConfigurationError(f"Recording can go on for 0 s or more after a drive, not for {tail} s.")
