"""Play a drive on the DAQ's outputs or on a player, or a waveform on a generator.

The order is always the same: the limiter authorises, stop signals are held back, the abort monitor is set
up, the relay connects once the limiter knows every output to be at zero, the drive plays. The safe state
follows in every case.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, InstrumentError, TakenError
from ...base.signals import uninterrupted
from ..daq import Block, Capture, Stream
from ..generator import Sweep, Waveform
from ..safety import Limiter, combined, exit_within
from .alignment import align, find
from .monitoring import (
    HZ,
    SHOWN,
    TOO_MUCH,
    UNPROVED,
    Monitoring,
    PlayRequest,
    UnshownError,
    level_of,
    loudest,
    tone,
)
from .roles import Instruments

_SLACK = 0.5
"""Time for a generator to answer its trigger and for a block to arrive (s)."""
_PROOF = Sweep(start_hz=HZ - 1, stop_hz=HZ + 1, duration=0.1, amplitude=1.0)
"""The generator's sweep that proves the gain."""


def _taken(error: BaseException | None) -> str:
    """What another program did to a play, if that is among the reasons of its error; or ""."""
    while error is not None and not isinstance(error, TakenError):
        error = error.__cause__ or error.__context__
    return str(error or "")


class Playing:
    """Plays on a rig what its limiter authorises, and calls `make_safe` after each play."""

    def __init__(
        self,
        rig: Instruments,
        limiter: Limiter,
        monitoring: Monitoring,
        make_safe: Callable[[], None],
        proved: set[str],
    ) -> None:
        """`proved` are the amplifier's inputs whose gain was proved in this session; a play adds its own.

        On a rig without a drive monitor it has those that the audit log says are not proved.
        """
        self._rig = rig
        self._limiter = limiter
        self._monitoring = monitoring
        self._make_safe = make_safe
        self._proved = proved

    def excite(self, drive: FloatArray, take: PlayRequest) -> Capture:
        """See `Rig.excite`."""
        rig = self._rig
        if rig.feeds_amplifier("generator") and not rig.feeds_amplifier("daq"):
            raise ConfigurationError(
                f"The generator feeds the amplifier of the rig {rig.name!r}: it sweeps patches (haploop "
                "calibrate, map), and plays no drive. Wire an output of the DAQ to the amplifier."
            )
        if rig.amplifier.inputs and take.patches:
            return self.excite_each(dict.fromkeys(take.patches, drive), take)
        if rig.amplifier.inputs:  # into open contacts, on every channel
            return self._played(dict.fromkeys(rig.amplifier.inputs.values(), drive), take)
        rate_hz = rig.table.rate_hz
        if not rig.feeds_amplifier("player"):
            own = {rig.amplifier.input: drive}
            self._prove_each(own, take.patches)
            return self._played(own, take)
        self._limiter.check({rig.player.output: drive}, rate_hz, self._limiter.kept.of(len(take.patches)))
        if drive.any() and take.patches:
            self.prove_gain(min(take.patches))
        capture, count = self._by_player(drive, take), len(drive) + take.samples_after(rate_hz)
        return self._aligned(capture, drive, take, count) if drive.any() else take.only(capture, count)

    def excite_each(self, drives: Mapping[str, FloatArray], take: PlayRequest) -> Capture:
        """See `Rig.excite_each`."""
        rig = self._rig
        inputs = rig.amplifier.inputs
        if len(drives) == 1 and not inputs:
            [drive] = drives.values()
            return self.excite(drive, take)
        missing = [patch for patch in drives if patch not in inputs]
        if missing or not drives:
            raise ConfigurationError(
                f"The amplifier of the rig {rig.name!r} has no channel of its own for patch "
                f"{', '.join(missing) or '(none was named)'}: play one patch at a time, or give 'input' in "
                "[amplifier] a name for each patch."
            )
        own = {inputs[patch]: drive for patch, drive in drives.items()}
        same = partial(np.array_equal, equal_nan=True)  # NaN is for the limiter to refuse
        mixed = [p for p, drive in drives.items() if not same(own[inputs[p]], drive)]
        if mixed:
            raise ConfigurationError(
                f"Patch {mixed[0]} shares its amplifier channel {inputs[mixed[0]]!r} with another patch, and "
                "they were to get different drives: give each patch in 'input' of [amplifier] its own."
            )
        self._prove_each(own, tuple(drives))
        return self._played(own, take)

    def generate(self, waveform: Waveform, take: PlayRequest) -> Capture:
        """See `Rig.generate`."""
        rig = self._rig
        if not rig.feeds_amplifier("generator"):
            raise ConfigurationError(
                f"The generator of the rig {rig.name!r} is wired to {rig.generator.output!r}, and its "
                f"amplifier's input is {rig.amplifier.input!r}: give both the same name in the rig file."
            )
        held_to = self._limiter.kept.of(len(take.patches))
        self._limiter.check_waveform(waveform, _SLACK, rig.amplifier, held_to)
        patch = min(take.patches, default="")
        self._prove(
            rig.generator.output,
            patch,
            lambda level: self._generated(replace(_PROOF, amplitude=level), self._proof(patch)),
        )
        return self._generated(waveform, take)

    def prove_gain(self, patch: str) -> None:
        """See `Rig.prove_gain`."""
        rig = self._rig
        rate_hz, level = rig.table.rate_hz, level_of(combined(self._limiter.kept.of(1)))
        source = rig.amplifier.inputs.get(patch, rig.amplifier.input)
        if rig.feeds_amplifier("player"):
            proof = PlayRequest((patch,), rig.drive_monitor().channels)
            self._prove(source, patch, lambda _: self._by_player(tone(level, rate_hz), proof))
        elif not rig.feeds_amplifier("generator"):
            self._prove_each({source: tone(level, rate_hz)}, (patch,))

    def _prove_each(self, drives: Mapping[str, FloatArray], patches: Collection[str]) -> None:
        """Prove the gain of what these drives of the DAQ's outputs pass; see `_prove`."""
        if not any(drive.any() for drive in drives.values()):
            return
        inputs, rate_hz = self._rig.amplifier.inputs, self._rig.table.rate_hz
        # All of them before the first is proved: what is refused is refused before anything is written.
        self._limiter.check(drives, rate_hz, self._limiter.kept.of(self._rig.amplifier.sharing(patches)))
        for source in drives:
            patch = next((p for p in sorted(patches) if inputs.get(p, source) == source), "")
            self._prove(
                source,
                patch,
                lambda level, s=source, p=patch: self._played(  # type: ignore[misc]
                    {s: tone(level, rate_hz)}, self._proof(p)
                ),
            )

    def _proof(self, patch: str) -> PlayRequest:
        """What is recorded of a proof: the monitor of the patch first, and every other one."""
        rig = self._rig
        others = rig.sensors.drive.channels if rig.sensors.drive else ()
        return PlayRequest((patch,), tuple(dict.fromkeys((rig.monitor(patch), *others))))

    def _prove(self, source: str, patch: str, play: Callable[[float], Capture]) -> None:
        """Prove the gain from an amplifier's input to a patch, once in a session, by the drive monitor.

        `play` plays an amplitude (V at the patch), and captures the patch's monitor and then the others.
        Nothing is proved with no patch connected, nor without a monitor: the audit log then says so. Locks
        the rig out with an InstrumentError for more volts than that, and raises UnshownError for less.
        """
        rig = self._rig
        if source in self._proved or not patch:
            return
        if rig.sensors.drive is None:
            self._limiter.note_unproved(source, UNPROVED)
            self._proved.add(source)
            return
        level = level_of(combined(self._limiter.kept.of(1)))
        capture = play(level)
        shown = [loudest(own, capture.rate_hz) for own in rig.sensors.drive.to_si(capture.volts)]
        # A volt that shows on the wrong monitor is as much evidence of a wrong gain.
        if not max(shown) <= TOO_MUCH * level:
            why = (
                f"Patch {patch} got {max(shown):.3g} V when {level:g} V were played to prove the gain: "
                "correct gain in [amplifier], ratio in [sensors.drive], or a player's volume."
            )
            self._limiter.lock_out(why)
            raise InstrumentError(f"{why} Nothing else was played; `haploop reset` clears the lockout.")
        if not shown[0] >= SHOWN * level:
            others = zip(capture.channels[1:], shown[1:], strict=True)
            elsewhere = tuple(channel for channel, volts in others if volts >= SHOWN * level)
            raise UnshownError(patch, shown[0] / level, elsewhere)
        self._proved.add(source)

    def _played(self, drives: Mapping[str, FloatArray], take: PlayRequest) -> Capture:
        """Play drives (V at the patch) on the DAQ's outputs."""
        rig = self._rig
        rate_hz = rig.table.rate_hz
        permitted = self._limiter.permit(drives, rate_hz, take.patches, rig.amplifier, self._limiter.kept.of)
        with uninterrupted(), permitted as volts:
            samples = len(next(iter(volts.values())))
            count = samples + take.samples_after(rate_hz)
            padded = {output: np.pad(v, (0, count - samples)) for output, v in volts.items()}
            with (
                self._monitoring.monitored(take, count) as (recorded, each),
                self._connected(take.patches),
                self._streamed(recorded, count, padded) as stream,
            ):
                capture = stream.capture(each)
            for patch in take.patches:
                own = drives[rig.amplifier.inputs.get(patch, next(iter(drives)))]
                self._refuse_unshown(patch, float(np.abs(own).max()), capture)
            return take.only(capture, count)

    def _refuse_unshown(self, patch: str, played: float, capture: Capture) -> None:
        """Raise UnshownError when a play of so many volts at a patch does not show on its monitor.

        A monitor that has died since the proof would let the next play through unseen: the gain is proved
        again before it. What is below the proof's own level is not judged.
        """
        rig = self._rig
        monitors = rig.sensors.drive
        source = rig.amplifier.inputs.get(patch, rig.amplifier.input)
        least = level_of(combined(self._limiter.kept.of(1)))
        if monitors is None or source not in self._proved or played < least:
            return
        rows = [capture.channels.index(channel) for channel in monitors.channels]
        shown = dict(zip(monitors.channels, monitors.to_si(capture.volts[rows]), strict=True))
        own = shown[rig.monitor(patch)]
        share = float(np.abs(own - np.median(own)).max()) / played
        if not share >= SHOWN:
            self._proved.discard(source)
            raise UnshownError(patch, share, (), "it was played")

    def _by_player(self, drive: FloatArray, take: PlayRequest) -> Capture:
        """Play a drive (V at the patch) on the player, and record until it has certainly been played."""
        rig = self._rig
        output, rate_hz = rig.player.output, rig.table.rate_hz
        permitted = self._limiter.permit(
            {output: drive}, rate_hz, take.patches, rig.amplifier, self._limiter.kept.of, rig.player.rendered
        )
        with uninterrupted(), permitted as volts:
            total = len(drive) + take.samples_after(rate_hz) + round(rig.player.max_latency * rate_hz)
            with (
                self._monitoring.monitored(take, total) as (recorded, each),
                self._connected(take.patches),
                self._streamed(recorded, total) as stream,
                exit_within(rig.player.identity, rig.player.play(volts[output], rate_hz)),
            ):
                return stream.capture(each)

    def _aligned(self, capture: Capture, drive: FloatArray, take: PlayRequest, count: int) -> Capture:
        """Put what a player played (V at the patch) on the drive's own clock, by the drive monitor."""
        rate_hz, monitor = self._rig.table.rate_hz, self._rig.drive_monitor()
        row = capture.channels.index(monitor.channels[0])
        measured = monitor.to_si(capture.volts[[row]])[0]
        delay = float(capture.delays[row])
        found = find(measured, drive, rate_hz, delay, self._rig.player.response)
        return take.only(align(capture, found, count), count)

    def _generated(self, waveform: Waveform, take: PlayRequest) -> Capture:
        """Play a waveform, in volts at the patch."""
        rig = self._rig
        permitted = self._limiter.permit_waveform(
            rig.generator.output, waveform, _SLACK, take.patches, rig.amplifier, self._limiter.kept.of
        )
        with uninterrupted(), permitted as at_output:
            return self._generated_at(at_output, take)

    def _generated_at(self, waveform: Waveform, take: PlayRequest) -> Capture:
        """Play a waveform, in volts at the generator's output."""
        rig = self._rig
        triggered: list[float] = []
        ended = False
        total = round((waveform.duration + take.tail + _SLACK) * rig.table.rate_hz)
        rig.generator.configure(waveform)
        with self._monitoring.monitored(take, total) as (recorded, each), self._connected(take.patches):

            def follow(block: Block) -> None:
                nonlocal ended
                each(block)
                if not triggered:
                    rig.generator.trigger()
                    triggered.append(rig.clock.now())
                elif not ended and rig.clock.now() >= triggered[0] + waveform.duration:
                    if not rig.generator.is_on:
                        raise InstrumentError(
                            f"The {rig.generator.identity} was switched off while its waveform was played: "
                            "what was measured is not used."
                        )
                    rig.generator.off()
                    ended = True

            rig.generator.arm()
            with self._streamed(recorded, total) as stream:
                whole = stream.capture(follow)
        if not ended:
            raise InstrumentError(
                f"The waveform of the {rig.generator.identity} had not ended when recording ended: it was "
                "too late to follow its trigger. Try again, and check its cable."
            )
        asked = waveform.amplitude / abs(float(rig.amplifier.to_input(np.ones(1))[0]))
        for patch in take.patches:
            self._refuse_unshown(patch, asked, whole)
        return take.only(whole, total)

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

        A play that another program has stopped locks the rig out: it may have written volts of its own.
        Raises InstrumentError for a patch that has been disconnected meanwhile, by this program too.
        """
        relay = self._rig.relay
        taken = ""
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
        except BaseException as error:
            taken = _taken(error)
            raise
        finally:
            try:
                # Zero first: the relay switches without voltage, and a patch is left without charge.
                self._make_safe()
            finally:
                if taken:
                    self._limiter.lock_out(f"The amplifier may have got another program's volts: {taken}")
