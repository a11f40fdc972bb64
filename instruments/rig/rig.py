"""A rig: every instrument that a rig file names, opened together and left in the safe state."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType
from typing import Any, Self

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock
from haploop.instruments.config import RigFile
from haploop.instruments.daq import Block, Capture
from haploop.instruments.driver import Mode, Simulation
from haploop.instruments.generator import Sweep
from haploop.instruments.interlock import Interlocked
from haploop.instruments.limits import Limits
from haploop.instruments.live import Feed, Publisher, Run, Tap
from haploop.instruments.progress import Progress, silent
from haploop.instruments.rig.declared_settings import DeclaredSettings
from haploop.instruments.rig.monitoring import Monitoring
from haploop.instruments.rig.playing import Playing
from haploop.instruments.rig.ratings import ratings
from haploop.instruments.rig.roles import Instruments
from haploop.instruments.safety import Audit, Limiter, Lockout, SafeState, combined, state_folder
from haploop.instruments.signals import at_console_close, ending_in_order, uninterrupted

__all__ = ["Rig"]


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
        self._safe = SafeState(self._roles, clock, self.audit)
        self._settings = DeclaredSettings()
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
        self._safe.adopt(role)

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
        return combined(ratings(self, patches))

    @property
    def lockout(self) -> Lockout | None:
        """The lockout that refuses every play until `haploop reset`; None without one."""
        return self._limiter.lockout

    @property
    def _playing(self) -> Playing:
        # Made for each play: kept, it would hold the rig that holds it, and a closed rig would keep its
        # simulated world until Python looks for cycles.
        monitoring = Monitoring(self, self.audit, self.hardware, self._limiter, self.live_run)
        return Playing(self, self.clock, self._limiter, monitoring, self.make_safe)

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
        laser = (self.vibrometer.channel, self.vibrometer.scale) if self.has("vibrometer") else None
        names, simulated = tuple(channels), self.simulated
        return self._feed.begin(Run(self.name, simulated, doing, about, names, rate_hz, self.sensors, laser))

    def confirm_settings(self) -> None:
        """Have the operator confirm, once, what no software can read. Raises InstrumentError."""
        self._settings.confirm(self)

    def excite(
        self,
        drive: FloatArray,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """Play a drive into patches and record channels on the drive's own clock.

        `drive` is (samples,) V at the patch at the table's rate; recording goes on for `tail`
        seconds of zero drive. The drive is checked against every limit before anything is
        written; the relay connects exactly `patches` while the output rests at zero, and opens
        again before this returns or raises. `progress` is told the seconds recorded, after each block.

        Whatever is wired to the amplifier's input plays: one of the DAQ's outputs, on the DAQ's
        clock, or the player. A player begins when it likes, on a clock of its own; the capture is
        then an `Aligned` one, moved to the drive's clock by what the drive monitor shows, and
        stopped when that shows more volts than the limits allow.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        return self._playing.excite(drive, patches, channels, tail, progress)

    def excite_each(
        self,
        drives: Mapping[str, FloatArray],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """Play a drive of its own into each of several patches at once; otherwise as `excite`.

        `drives` are (samples,) V at each patch, all of one length. Each is checked as the drive of
        one patch. Raises ConfigurationError for an amplifier without a channel for each patch, and
        as `excite` does.
        """
        return self._playing.excite_each(drives, channels, tail, progress)

    def sweep(
        self,
        sweep: Sweep,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """Let the generator sweep patches, as the paper's did, and record channels meanwhile.

        `sweep.amplitude` is V peak at the patch here; the generator gets what that is at the
        amplifier's input. Recording begins before the sweep and goes on for `tail` seconds after
        it, in which the output is off. No clock is shared and nothing is aligned: the capture has
        the sweep somewhere in it, and the drive monitor shows where. No generator fades its sweep out:
        of the limits, the offset, the ends and the step with which it is switched off are not held.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        return self._playing.sweep(sweep, patches, channels, tail, progress)

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
