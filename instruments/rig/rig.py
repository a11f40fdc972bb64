"""A rig: every instrument that a rig file names, opened together and left in the safe state."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

import numpy as np

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock
from haploop.instruments.config import RigFile
from haploop.instruments.daq import Block, Capture, Stream
from haploop.instruments.driver import Mode, Simulation
from haploop.instruments.errors import ConfigurationError, InstrumentError
from haploop.instruments.generator import Sweep
from haploop.instruments.interlock import Interlocked
from haploop.instruments.limits import Limits
from haploop.instruments.live import Feed, Publisher, Run, Tap
from haploop.instruments.operator import ConfirmSettings
from haploop.instruments.rig.alignment import align, find
from haploop.instruments.rig.roles import Instruments
from haploop.instruments.safety import (
    AbortMonitor,
    Audit,
    Limiter,
    Lockout,
    SafeState,
    combined,
    exit_within,
    state_folder,
    trip,
)
from haploop.instruments.signals import at_console_close, deliver, ending_in_order, uninterrupted

__all__ = ["Rig"]

_SLACK = 0.5
"""Seconds within which a generator has answered its trigger, and a block has come."""


class Rig(Instruments):
    """Open instruments. Made by `open_rig`; a context whose exit reaches the safe state."""

    def __init__(
        self,
        file: RigFile,
        clock: Clock,
        simulation: Simulation | None,
        mode: Mode | None,
        hardware: Collection[str],
    ) -> None:
        super().__init__(file)
        self.clock = clock
        self.simulation = simulation
        self.mode = mode
        self.hardware = frozenset(hardware)
        """Hardware that no second rig may use at once, and that a lockout is set on."""
        self.audit = Audit(file, state_folder(file, mode is not None), mode is not None)
        self._limiter = Limiter(clock, self.audit, self.hardware)
        self._confirmed: set[str] = set()
        self._safe = SafeState(self._roles, clock, self.audit)
        self._feed = Feed()
        self._stack = ExitStack()
        self._signals = ExitStack()

    def holding(self, context: AbstractContextManager[object]) -> None:
        """Enter what must outlast the instruments: a lock on them, or the world that they are in."""
        self._stack.enter_context(context)

    def adopt(self, role: str, instrument: Any) -> None:
        """Own an open instrument, and close it with the rig; its interlock is the rig's limiter."""
        if isinstance(instrument, Interlocked):
            instrument._interlock = self._limiter
        self._roles[role] = instrument
        if hasattr(instrument, "close"):
            self._stack.callback(self._safe.let_go, role)

    def complete(self) -> None:
        """Every instrument is here: from now on, whatever ends the program reaches the safe state first."""
        self.audit.note("opened", instruments={r: getattr(i, "identity", "") for r, i in self._roles.items()})
        self._stack.callback(self.audit.note_at_last, "closed")
        self._stack.callback(self.make_safe)
        self._signals.enter_context(ending_in_order())
        self._signals.enter_context(at_console_close(self.make_safe))
        atexit.register(self.close)

    @property
    def simulated(self) -> bool:
        """Whether anything that this rig measures is simulated, as far as its cards tell."""
        return self.simulation is not None or self.daq.simulated

    @property
    def limits(self) -> Limits:
        """The strictest of the rig's own limits, the amplifier's, one patch's and the relay's."""
        return self.limits_for(1)

    def limits_for(self, patches: int) -> Limits:
        """As `limits`, with `patches` patches in parallel."""
        return combined(self._ratings(patches))

    @property
    def lockout(self) -> Lockout | None:
        """The lockout that refuses every play until `haploop reset`; None without one."""
        return self._limiter.lockout

    def tap(self, capacity: int = 16) -> Tap:
        """The newest blocks of every recording and play from now on, for a live view. See `Tap`."""
        return self._feed.tap(capacity)

    def publish_live(self) -> Publisher:
        """Let other programs of this user watch the rig by `watch_live`, while this context lasts.

        Raises InstrumentError when the state folder cannot be written, or no socket can be opened.
        """
        return Publisher(self._feed, self.name, self.audit.folder)

    def live_run(
        self, doing: str, about: str, channels: Collection[str], rate_hz: float
    ) -> Callable[[Block], None]:
        """Begin a run for live views. Returns the function that publishes each block, and never waits."""
        laser = (self.vibrometer.channel, self.vibrometer.scale) if "vibrometer" in self._roles else None
        names, simulated = tuple(channels), self.simulated
        return self._feed.begin(Run(self.name, simulated, doing, about, names, rate_hz, self.sensors, laser))

    def confirm_settings(self) -> None:
        """Have the operator confirm, once, what no software can read. Raises InstrumentError."""
        declared = {self.vibrometer.identity: self.vibrometer.declared}
        if self._wired("player"):
            declared[self.player.identity] = self.player.declared
        for identity, sentence in declared.items():
            if not sentence or sentence in self._confirmed:
                continue
            if not self.operator.confirm(ConfirmSettings(sentence)):
                raise InstrumentError(
                    f"The operator did not confirm the settings of the {identity}: "
                    "set them as the rig file says, or change the rig file."
                )
            self._confirmed.add(sentence)

    def excite(
        self,
        drive: FloatArray,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Callable[[float], None] = lambda _seconds: None,
    ) -> Capture:
        """Play a drive into patches and record channels on the drive's own clock.

        `drive` is (samples,) V at the patch at the table's rate; recording goes on for `tail`
        seconds of zero drive. The drive is checked against every limit before anything is
        written; the relay connects exactly `patches` while the output rests at zero, and opens
        again before this returns or raises. `progress` is told the seconds of each block.

        Whatever is wired to the amplifier's input plays: one of the DAQ's outputs, on the DAQ's
        clock, or the player. A player begins when it likes, on a clock of its own; the capture is
        then an `Aligned` one, moved to the drive's clock by what the drive monitor shows, and
        stopped when that shows more volts than the limits allow.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        if self.amplifier.inputs:
            return self.excite_each(dict.fromkeys(patches, drive), channels, tail, progress)
        rate_hz = self.table.rate_hz
        _refuse_tail(tail)
        if not self._wired("player"):
            return self._played({self.amplifier.input: drive}, patches, channels, tail, progress)
        output, rendered = self.player.output, self.player.rendered
        permitted = self._limiter.permit(
            {output: drive}, rate_hz, frozenset(patches), self.amplifier, self._ratings, rendered
        )
        with uninterrupted(), permitted as volts:
            count = len(drive) + max(1, round(tail * rate_hz))
            return self._excite_by_player(drive, volts[output], patches, channels, count, progress)

    def excite_each(
        self,
        drives: Mapping[str, FloatArray],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Callable[[float], None] = lambda _seconds: None,
    ) -> Capture:
        """Play a drive of its own into each of several patches at once; otherwise as `excite`.

        `drives` are (samples,) V at each patch, all of one length. Each is checked as the drive of
        one patch. Raises ConfigurationError for an amplifier without a channel for each patch, and
        as `excite` does.
        """
        inputs = self.amplifier.inputs
        missing = [patch for patch in drives if patch not in inputs]
        if missing or not drives:
            raise ConfigurationError(
                f"The amplifier of the rig {self.name!r} has no channel of its own for patch "
                f"{', '.join(missing) or '(none was named)'}: play one patch at a time, or give 'input' in "
                "[amplifier] a name for each patch."
            )
        _refuse_tail(tail)
        own = {inputs[patch]: drive for patch, drive in drives.items()}
        return self._played(own, tuple(drives), channels, tail, progress)

    def sweep(
        self,
        sweep: Sweep,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Callable[[float], None] = lambda _seconds: None,
    ) -> Capture:
        """Let the generator sweep patches, as the paper's did, and record channels meanwhile.

        `sweep.amplitude` is V peak at the patch here; the generator gets what that is at the
        amplifier's input. Recording begins before the sweep and goes on for `tail` seconds after
        it, in which the output is off. No clock is shared and nothing is aligned: the capture has
        the sweep somewhere in it, and the drive monitor shows where. No generator fades its sweep out:
        of the limits, the offset, the ends and the step with which it is switched off are not held.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        _refuse_tail(tail)
        if not sweep.amplitude > 0:
            raise ConfigurationError(f"A sweep needs an amplitude above 0 V, and this has {sweep.amplitude}.")
        if not self._wired("generator"):
            raise ConfigurationError(
                f"The generator of the rig {self.name!r} is wired to {self.generator.output!r}, and its "
                f"amplifier's input is {self.amplifier.input!r}: give both the same name in the rig file."
            )
        permitted = self._limiter.permit_sweep(
            self.generator.output, sweep, _SLACK, frozenset(patches), self.amplifier, self._ratings
        )
        with uninterrupted(), permitted as at_output:
            return self._swept(at_output, patches, channels, tail, progress)

    def make_safe(self) -> None:
        """Nothing plays, outputs at zero, then every relay channel open, read back. Idempotent.

        Everything is tried whatever the others do, and nothing is waited for without end. Raises
        InstrumentError when any failed.
        """
        self._safe.reach()

    def close(self) -> None:
        """Safe state first, then let go of the instruments in reverse order. May be called again."""
        try:
            with uninterrupted():
                self._stack.close()
        finally:
            self._feed.close()
            self._signals.close()
            atexit.unregister(self.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        interrupted: KeyboardInterrupt | None = None
        while True:
            try:
                self.close()
            except KeyboardInterrupt as stop:
                # It may have come before signals were held back, with everything still to be done.
                interrupted = stop
            else:
                break
        if interrupted is not None:
            raise interrupted

    def _played(
        self,
        drives: Mapping[str, FloatArray],
        patches: Collection[str],
        channels: Sequence[str],
        tail: float,
        progress: Callable[[float], None],
    ) -> Capture:
        """Drives (V at the patch) played on the DAQ's outputs."""
        rate_hz = self.table.rate_hz
        permitted = self._limiter.permit(drives, rate_hz, frozenset(patches), self.amplifier, self._ratings)
        with uninterrupted(), permitted as volts:
            samples = len(next(iter(volts.values())))
            count = samples + max(1, round(tail * rate_hz))
            padded = {output: np.pad(v, (0, count - samples)) for output, v in volts.items()}
            with (
                self._monitored(patches, channels, progress) as (recorded, each),
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
        progress: Callable[[float], None],
    ) -> Capture:
        rate_hz, monitor = self.table.rate_hz, self._monitor()
        total = count + round(self.player.room * rate_hz)
        with (
            self._monitored(patches, channels, progress) as (recorded, each),
            self._connected(patches),
            self._streamed(recorded, total) as stream,
            exit_within(self.player.identity, self.player.play(volts, rate_hz)),
        ):
            capture = stream.capture(each)
        if drive.any():
            row = recorded.index(monitor.channels[0])
            measured = monitor.to_si(capture.volts[[row]])[0]
            delay = float(capture.delays[row])
            capture = align(capture, find(measured, drive, rate_hz, delay, self.player.response), count)
        return _only(channels, capture, count)

    def _swept(
        self,
        sweep: Sweep,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float,
        progress: Callable[[float], None],
    ) -> Capture:
        """`sweep` is V at the generator's output."""
        triggered: list[float] = []
        ended = False
        total = round((sweep.duration + tail + _SLACK) * self.table.rate_hz)
        self.generator.configure(sweep)
        with (
            self._monitored(patches, channels, progress) as (recorded, each),
            self._connected(patches),
        ):

            def follow(block: Block) -> None:
                nonlocal ended
                each(block)
                if not triggered:
                    self.generator.trigger()
                    triggered.append(self.clock.now())
                elif not ended and self.clock.now() >= triggered[0] + sweep.duration:
                    self.generator.off()
                    ended = True

            self.generator.arm()
            with self._streamed(recorded, total) as stream:
                capture = _only(channels, stream.capture(follow), total)
        if not ended:
            raise InstrumentError(
                f"The sweep of the {self.generator.identity} had not ended when recording ended: it was too "
                "late to follow its trigger. Try again, and check its cable."
            )
        return capture

    def _ratings(self, patches: int) -> dict[str, Limits]:
        """Everybody's limits, with `patches` patches in parallel."""
        table = self.table
        patch = Limits(
            min=table.patch_min, max=table.patch_max, capacitance=patches * table.patch_capacitance
        )
        relay = Limits(min=-self.relay.rating, max=self.relay.rating)
        return {
            "the amplifier": self.amplifier.limits(patches),
            "the relay": relay,
            "the patch": patch,
            "the rig file's [limits]": self.file.limits.limits(),
        }

    def _streamed(
        self, channels: Sequence[str], samples: int, play: Mapping[str, FloatArray] | None = None
    ) -> AbstractContextManager[Stream]:
        """A stream at the table's rate, in blocks of a tenth of a second."""
        rate_hz = self.table.rate_hz
        stream = self.daq.stream(channels, rate_hz, round(rate_hz / 10), samples, play)
        return exit_within(self.daq.identity, stream)

    @contextmanager
    def _connected(self, patches: Collection[str]) -> Iterator[None]:
        """Exactly these patches, with nothing played before, and the safe state after."""
        try:
            self.daq.zero()
            self.relay.connect(patches)
            yield
        finally:
            # Zero first: the relay switches without voltage, and a patch is left without charge.
            self.make_safe()

    @contextmanager
    def _monitored(
        self, patches: Collection[str], channels: Sequence[str], progress: Callable[[float], None]
    ) -> Iterator[tuple[tuple[str, ...], Callable[[Block], None]]]:
        """The channels to record, the monitored ones among them, and the function to call on every block.

        The function renews the relay's dead man, tests the block, reports progress and delivers signals,
        which are otherwise held back from before the first volt until the safe state. A block that trips
        is an InstrumentError; the rig is locked out once the safe state has been tried.
        """
        laser = self.vibrometer if "vibrometer" in self._roles else None
        limits = self.limits_for(len(frozenset(patches)))
        abort_monitor = AbortMonitor(self.file.abort, self.sensors, laser, limits)
        recorded = tuple(dict.fromkeys([*channels, *abort_monitor.channels]))

        publish = self.live_run("play", f"patch {', '.join(sorted(patches))}", recorded, self.table.rate_hz)

        def each(block: Block) -> None:
            self.relay.renew()
            abort_monitor.check(block, recorded)
            publish(block)
            progress(block.volts.shape[1] / self.table.rate_hz)
            deliver()

        try:
            yield recorded, each
        finally:
            if abort_monitor.tripped is not None:
                rate_hz = self.table.rate_hz
                self._limiter.unsaved_lockout = trip(
                    self.audit, self.hardware, abort_monitor, recorded, rate_hz
                )


def _only(channels: Sequence[str], capture: Capture, samples: int) -> Capture:
    """The channels that were asked for, and no more than `samples`."""
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
