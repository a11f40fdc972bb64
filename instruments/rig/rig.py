"""A rig: every instrument that a rig file names, opened together and left in the safe state."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from copy import copy, deepcopy
from dataclasses import replace
from typing import Any, Self

import numpy as np

from ...base.arrays import FloatArray
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError
from ...base.notebook import InNotebook
from ...base.progress import Progress, silent
from ...base.signals import at_console_close, at_program_end, ending_in_order, uninterrupted
from ..amplifier import ReadOnce
from ..config import RigFile
from ..daq import Block, Capture, Daq
from ..driver import Mode, Simulation
from ..generator import Waveform
from ..interlock import Interlocked
from ..limits import Limits
from ..live import Feed, Publisher, Run, Tap
from ..operator import ConfirmSettings
from ..safety import (
    Audit,
    Limiter,
    Lockout,
    Lockouts,
    Outputs,
    SafeState,
    combined,
    lockouts_folder,
    state_folder,
)
from .monitoring import Monitoring, PlayRequest
from .playing import Playing
from .roles import Instruments, Part, Role, ratings


class DeclaredSettings:
    """The declared settings of a rig's instruments that are already confirmed."""

    def __init__(self) -> None:
        self._confirmed: set[str] = set()

    def confirm(self, rig: Instruments) -> None:
        """See `Rig.confirm_settings`."""
        declared = {rig.vibrometer.identity: rig.vibrometer.declared, rig.daq.identity: rig.daq.declared}
        if rig.feeds_amplifier("player"):
            declared[rig.player.identity] = rig.player.declared
        for identity, sentence in declared.items():
            if not sentence or sentence in self._confirmed:
                continue
            if not rig.operator.confirm(ConfirmSettings(sentence)):
                raise InstrumentError(
                    f"The operator did not confirm the settings of the {identity}: "
                    "set them as the rig file says, or change the rig file."
                )
            self._confirmed.add(sentence)


class Rig(Instruments, InNotebook):
    """Open instruments. Made by `open_rig`; a context whose exit reaches the safe state."""

    def __init__(
        self,
        file: RigFile,
        clock: Clock,
        simulation: Simulation | None,
        mode: Mode | None,
        hardware: Collection[str],
    ) -> None:
        super().__init__(deepcopy(file), clock)
        self._own = Instruments(self._file, clock)
        """For plays."""
        self.simulation = simulation
        self.mode = mode
        self.hardware = frozenset(hardware)
        """Pieces of hardware that one rig may use at a time, and on which a lockout is set."""
        own = getattr(simulation, "state", None)  # of a tape, whose plays are nobody's acts
        self.audit = Audit(file, own or state_folder(file, mode is not None), mode is not None)
        direct = file.table.patches if file.wiring == "direct" and file.amplifier and file.table else ()
        self._outputs = Outputs(self._roles, direct)
        folder = lockouts_folder(self.audit.folder, mode is not None)
        self._lockouts = Lockouts(folder, self.hardware, self.audit)
        # A simulated rig's world is new at each opening: nothing was played in it.
        self._limiter = Limiter(clock, self._lockouts, self._outputs, None if mode is not None else folder)
        self._safe = SafeState(
            self._roles, clock, self.audit, self._outputs, self._limiter.lock_out, self._limiter.keep_watch
        )
        self._settings = DeclaredSettings()
        self._proved: set[str] = set()
        self._feed = Feed()
        self._stack = ExitStack()
        self._signals = ExitStack()
        self._closed = False
        self._process = os.getpid()
        # Two threads that do the same wait for each other: each takes all of its steps.
        self._reaching, self._closing = threading.RLock(), threading.RLock()
        self._collections: list[list[Capture]] = []

    def adopt(self, role: str, instrument: Any) -> None:
        """Take over an open instrument: close it with the rig, and make the limiter its interlock."""
        if isinstance(instrument, Interlocked):
            instrument._interlock = self._limiter
            instrument._shown = frozenset(name for name in vars(instrument) if not name.startswith("_"))
        self._roles[role] = instrument
        if hasattr(instrument, "close"):
            self._stack.callback(self._safe.let_go, role)
        self._safe.adopt(role)

    def complete(self) -> None:
        """Finish opening: from now on, the safe state is reached before the program ends in any way."""
        self._limiter.recall()
        self._read_once()
        self.audit.note("opened", instruments={r: getattr(i, "identity", "") for r, i in self._roles.items()})
        self._limiter.begin()
        self._stack.callback(self.audit.note_at_last, "closed")
        self._stack.callback(self._limiter.wait_for_play)
        self._stack.callback(self.make_safe)
        self._stack.callback(self._limiter.end)
        self._signals.enter_context(ending_in_order())
        self._signals.enter_context(at_console_close(self.make_safe))
        self._signals.enter_context(at_program_end(self.close))

    def _read_once(self) -> None:
        """Read what plays rest on: what a program writes to the rig or its parts later, they do not see."""
        own = self._own
        own._roles.update(self._roles)
        if self.has("vibrometer"):
            own._roles["vibrometer"] = copy(self.vibrometer)
        self._outputs.read_wiring()
        try:
            own._roles["amplifier"] = ReadOnce(self.amplifier, len(own.table.patches))
            self._limiter.kept.keep(tuple(ratings(own, n) for n in range(len(own.table.patches) + 1)))
        except ConfigurationError as error:  # it has no table, or nothing to play on
            self._limiter.kept.keep((), str(error))

    def __repr__(self) -> str:
        state = "closed" if self.is_closed else "open"
        kind = f"simulated by its {self.mode}" if self.mode else "its hardware"
        return f"<Rig {self.name}: {state}, {kind}; {', '.join(self.instruments)}>"

    def _copied(self, part: Part) -> Part:
        """What a program writes to the file, or to a part of it, reaches no play."""
        return deepcopy(part)

    @property
    def is_closed(self) -> bool:
        """True once the rig was closed: it has given up its lock, and plays and reads no more.

        Always true in a forked child: the rig, its lock and its connections are the parent's.
        """
        return self._closed or self._process != os.getpid()

    @property
    def simulated(self) -> bool:
        """True when any measurement of this rig is simulated, as far as its cards report it."""
        return self.simulation is not None or bool(self._roles["daq"].simulated)

    @property
    def limits(self) -> Limits:
        """The strictest of the rig's own limits, the amplifier's, one patch's and the relay's."""
        return self.limits_for(1)

    def limits_for(self, patches: int) -> Limits:
        """The strictest limits, as `limits`, for `patches` patches in parallel."""
        return combined(ratings(self._own, patches))

    @property
    def lockout(self) -> Lockout | None:
        """The lockout that refuses every play until `haploop reset`; None without one."""
        return self._limiter.lockout

    @property
    def _playing(self) -> Playing:
        # Created for each play: stored, it would form a reference cycle with the rig, and a closed rig
        # would keep its simulated world until the garbage collector runs.
        self.role(Daq)  # a closed rig plays nothing
        monitoring = Monitoring(self._own, self._lockouts, self._limiter, self.live_run)
        return Playing(self._own, self._limiter, monitoring, self.make_safe, self._proved)

    def tap(self, capacity: int = 16) -> Tap:
        """Return a tap on the newest blocks of all further recordings and plays. See `Tap`."""
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
        shown = self.vibrometer if self.has("vibrometer") else None
        laser = None if shown is None else (shown.channel, shown.scale, shown.quantity)
        names, simulated = tuple(channels), self.simulated
        return self._feed.begin(Run(self.name, simulated, doing, about, names, rate_hz, self.sensors, laser))

    def confirm_settings(self) -> None:
        """Have the operator confirm, once, the settings that no software reads. Raises InstrumentError."""
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
        again before this returns or raises. `progress` receives the seconds recorded, after each block.

        The source is wired to the amplifier's input: one of the DAQ's outputs, on the DAQ's clock,
        or the player. A player starts at an unknown time, on its own clock; the capture is then an
        `Aligned` one, resampled to the drive's clock by means of the drive monitor. The play is
        stopped when the drive monitor shows more volts than the limits allow.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        return self._collected(self._playing.excite(drive, PlayRequest(patches, channels, tail, progress)))

    def excite_each(
        self,
        drives: Mapping[str, FloatArray],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """Play a separate drive into each of several patches at once; otherwise as `excite`.

        `drives` are (samples,) V at each patch, all of one length. Each is checked as the drive of
        one patch. One alone is played on any amplifier. Raises ConfigurationError for an amplifier without a
        channel for each patch, and as `excite` does.
        """
        return self._collected(
            self._playing.excite_each(drives, PlayRequest(drives, channels, tail, progress))
        )

    def generate(
        self,
        waveform: Waveform,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Progress = silent,
    ) -> Capture:
        """Play a waveform of the generator into patches, as in the paper, and record channels meanwhile.

        The waveform is in volts at the patch, and is converted to the amplifier's input for the
        generator. Recording begins before it and goes on for `tail` seconds after it, with the
        output off. No clock is shared and nothing is aligned: the drive monitor shows where the waveform
        is in the capture. No generator fades a sweep out: to a waveform that goes on, the limits of the
        offset, of the ends, and of the step at switch-off are not applied.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        return self._collected(
            self._playing.generate(waveform, PlayRequest(patches, channels, tail, progress))
        )

    def prove_gain(self, patch: str) -> None:
        """Prove the amplifier's gain at a volt now, where the first play into this patch would do it.

        For a program whose first play must not be late. Raises as `excite` does.
        """
        self._playing.prove_gain(patch)

    def forget_gain(self) -> None:
        """Prove the amplifier's gain again before the next play: somebody has changed its wiring."""
        self._proved.clear()

    @contextmanager
    def captures(self) -> Iterator[list[Capture]]:
        """Collect the capture of every play while this context lasts, in order, settling included.

        In single precision: a calibration's are tens of megabytes.
        """
        collected: list[Capture] = []
        self._collections.append(collected)
        try:
            yield collected
        finally:
            self._collections.pop()

    def _collected(self, capture: Capture) -> Capture:
        for collected in self._collections:
            collected.append(replace(capture, volts=capture.volts.astype(np.float32)))
        return capture

    def make_safe(self) -> None:
        """Stop all plays, set outputs to zero, then open every relay channel and read it back. Idempotent.

        Every step is tried, even when another fails, and each has a deadline. Raises InstrumentError
        when any failed. A rig that was closed is left alone: another program may hold its hardware.
        """
        if not self.is_closed:
            with self._reaching:
                if not self._closed:
                    self._safe.reach()

    def close(self) -> None:
        """Reach the safe state, then close the instruments in reverse order. May be called again.

        A play of another thread is an error, and has ended before its instruments are closed. Does nothing
        in a forked child.
        """
        if self._process != os.getpid():
            return
        try:
            with uninterrupted(), self._closing:
                self._stack.close()
        finally:
            self._closed = True
            self._feed.close()
            self._signals.close()

    def role(self, kind: type[Role]) -> Role:
        """See `Instruments.role`. Raises ConfigurationError also for a rig that was closed.

        A closed rig has given up its lock: another program may hold the same hardware.
        """
        if self._closed:
            raise ConfigurationError(f"The rig {self.name!r} was closed: open it again with open_rig.")
        if self.is_closed:
            raise ConfigurationError(
                f"The rig {self.name!r} is open in process {self._process}, of which this one is a fork: use "
                "it there only."
            )
        return super().role(kind)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        interrupted: KeyboardInterrupt | None = None
        while True:
            try:
                self.close()
            except KeyboardInterrupt as stop:
                # It may have come before signals were held back, with nothing closed yet.
                interrupted = stop
            else:
                break
        if interrupted is not None:
            raise interrupted
