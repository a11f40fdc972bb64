"""The limiter of a rig: authorises every waveform for every output, in volts at the patch.

It is the interlock of every instrument of the rig. A drive is judged once, whole, before anything is
written (`judge.py`); then exactly that drive, and nothing else, is authorised while its permit lasts.
"""

from __future__ import annotations

import hashlib
import os
import threading
import weakref
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.clock import Clock
from ...base.errors import DataError, InstrumentError, LimitError
from ...base.threads import Flag
from ..amplifier import Amplifier
from ..generator import Waveform
from ..limits import Limits, sounding
from ..relay import LOST
from .deadline import DEADLINE, Watch
from .judge import Heating, Judge, Ratings, ReadRatings, combined
from .lockout import Lockout, Lockouts
from .safe_state import Outputs, Standing

Rendered = Callable[[FloatArray, float], tuple[FloatArray, float]]
"""See `Player.rendered`."""


@dataclass(frozen=True, eq=False)
class _Permit:
    """The drives authorised now. `volts` is (samples,) V at each output; `waveforms` are in V there too."""

    patches: frozenset[str]
    rate_hz: float
    volts: Mapping[str, FloatArray]
    waveforms: Mapping[str, Waveform]


class Limiter:
    """See `haploop.instruments.interlock.Interlock`. Thread-safe; there is one permit at a time.

    It holds no reference to the rig: every instrument refers to it, and the reference cycle would keep
    a closed rig in memory.
    """

    def __init__(self, clock: Clock, lockouts: Lockouts, outputs: Outputs, counted: Path | None) -> None:
        """`counted` is the folder of what was played; None to forget it.

        With it, `clock` is the one that all programs of the computer share.
        """
        self._clock = clock
        self._audit = lockouts.audit
        self._lockouts = lockouts
        self._outputs = weakref.ref(outputs)
        self._lock = threading.Lock()
        self._permit: _Permit | None = None
        self._player = 0
        """Thread that has the permit."""
        self._idle = Flag()
        self._idle.set()
        self._process: int | None = os.getpid()
        """The process in which the rig is open."""
        self._playing: set[str] = set()
        """Outputs that have started: each starts once, because a restart would cut its drive off."""
        self._judge = Judge(clock, lockouts, counted)
        self.warm = 0.0
        """What earlier plays had left in a coil (W) when the present one began."""
        self._watch = Watch(clock, self.authorise_renewal)
        self.kept = ReadRatings()

    @property
    def lockout(self) -> Lockout | None:
        """The lockout that refuses every drive until `haploop reset`; None without one."""
        return self._lockouts.present

    # Called by the rig

    def recall(self) -> None:
        """Take over what other programs have played on this hardware, once the rig has its lock."""
        self._judge.recall()

    def note_unproved(self, source: str, why: str) -> None:
        """Log that the gain from an amplifier's input is not proved. Raises DataError for a full disk."""
        self._audit.note("unproved", input=source, why=why)

    def begin(self) -> None:
        """Bring an actuator that no relay parts from the amplifier to zero volts, and watch it from now on.

        Raises InstrumentError when its outputs are not known to be at zero.
        """
        outputs = self._outputs()
        if outputs is None or not outputs.direct:
            return
        found = outputs.found()
        if found:
            limits = combined(self.kept.of(1)) if self.kept else Limits()
            self._judge.heat.stood(limits, outputs.at_actuator(found))
        self._audit.note("connected", patches=sorted(outputs.direct), found=found, why=LOST)
        self._known(Outputs.rest)
        self._watch.begin()

    def end(self) -> None:
        """Authorise nothing any more: the rig is being closed."""
        self._process = None
        outputs = self._outputs()
        if outputs is not None and outputs.direct:
            self._watch.end()

    def lock_out(self, why: str) -> None:
        """Refuse every play on this hardware until `haploop reset`; then its coil is as warm as it may be."""
        self._lockouts.lock_out(why)
        self._lose_heat()

    def wait_for_play(self) -> None:
        """Wait, for a while, until another thread's play, which was stopped, has been left."""
        if self._player != threading.get_ident():
            self._idle.wait(DEADLINE)

    @contextmanager
    def permit(
        self,
        drives: Mapping[str, FloatArray],
        rate_hz: float,
        patches: Collection[str],
        amplifier: Amplifier,
        ratings: Callable[[int], Ratings],
        rendered: Rendered | None = None,
    ) -> Iterator[dict[str, FloatArray]]:
        """Permit each drive ((samples,) V at the patch) on its output while the context lasts.

        Patches that share an output get its drive in parallel. `ratings` returns the limits for a number of
        patches in parallel. `rendered` returns the waveform of an output
        that does not play a drive sample by sample. Yields each drive as (samples,) V at its
        output. Raises LimitError before anything is written.
        """
        held_to = ratings(amplifier.sharing(patches))
        own = {output: np.array(drive) for output, drive in drives.items()}
        with self.refusals_noted():
            self._refuse_elsewhere(patches, any(drive.any() for drive in own.values()))
            seconds = self._check_each(own, rate_hz, held_to)
            volts = {output: amplifier.to_input(drive) for output, drive in own.items()}
            if rendered is not None:
                gain = 1 / float(amplifier.to_input(np.ones(1))[0])
                # It rings before and after the drive, so its ends and its length are not checked.
                free = {"max_end": np.inf, "max_offset": np.inf, "max_duration": np.inf}
                for at_output in volts.values():
                    made, made_hz = rendered(at_output, rate_hz)
                    self._judge.check(gain * made, made_hz, held_to, **free)
        strictest = combined(held_to)
        warmest = max(strictest.heat(drive, rate_hz) for drive in own.values())
        heat = Heating(strictest, warmest, len(next(iter(own.values()))) / rate_hz)
        peak = max(float(np.abs(drive).max()) for drive in own.values())
        digest = hashlib.sha256(b"".join(drive.tobytes() for drive in own.values())).hexdigest()
        permit = _Permit(frozenset(patches), rate_hz, volts, {})
        output = ", ".join(own)
        with self._lasting(permit, seconds, heat, output=output, peak=peak, rate_hz=rate_hz, sha256=digest):
            yield volts

    @contextmanager
    def permit_waveform(
        self,
        output: str,
        waveform: Waveform,
        rest: float,
        patches: Collection[str],
        amplifier: Amplifier,
        ratings: Callable[[int], Ratings],
    ) -> Iterator[Waveform]:
        """Permit a generator at `output` to play a waveform (V at the patch) while the context lasts.

        Yields it in volts at that output. The generator is switched off within `rest` seconds after its
        end. Raises LimitError before anything is set.
        """
        gain = 1 / float(amplifier.to_input(np.ones(1))[0])
        at_output = waveform.scaled(1 / gain)
        held_to = ratings(len(patches))
        with self.refusals_noted():
            self._refuse_elsewhere(patches, True)
        seconds = self.check_waveform(waveform, rest, amplifier, held_to)
        permit = _Permit(frozenset(patches), 0.0, {}, {output: at_output})
        peak = gain * at_output.amplitude
        volts, rate_hz = at_output.sampled(rest)
        strictest = combined(held_to)
        warmest = strictest.heat(gain * np.asarray(volts, dtype=np.float64), rate_hz)
        heat = Heating(strictest, warmest, len(volts) / rate_hz)
        with self._lasting(permit, seconds, heat, output=output, peak=peak, waveform=str(at_output)):
            yield at_output

    def check(self, drives: Mapping[str, FloatArray], rate_hz: float, ratings: Ratings) -> None:
        """Refuse drives ((samples,) V at the patch) that `permit` would refuse. Raises LimitError."""
        with self.refusals_noted():
            self._check_each(drives, rate_hz, ratings)

    def _check_each(self, drives: Mapping[str, FloatArray], rate_hz: float, ratings: Ratings) -> float:
        """Refuse drives beyond a limit; return for how long they sound (s). Raises LimitError."""
        for drive in drives.values():
            self._judge.check(drive, rate_hz, ratings)
        if len({len(drive) for drive in drives.values()}) > 1:
            raise LimitError("Drives that are played at once must be of one length.")
        spans = [sounding(drive) for drive in drives.values() if drive.any()]
        seconds = (max(s for _, s in spans) - min(f for f, _ in spans)) / rate_hz if spans else 0.0
        self._judge.check_duty(seconds, ratings)
        return seconds

    def check_waveform(
        self, waveform: Waveform, rest: float, amplifier: Amplifier, held_to: Ratings
    ) -> float:
        """Refuse a waveform (V at the patch) that `permit_waveform` would refuse; return its seconds.

        Raises LimitError.
        """
        gain = 1 / float(amplifier.to_input(np.ones(1))[0])
        with self.refusals_noted():
            seconds = self._judge.judge(waveform.scaled(1 / gain), gain, rest, held_to)
            self._judge.check_duty(seconds, held_to)
        return seconds

    # Called by the instruments

    def authorise(self, output: str, volts: FloatArray, rate_hz: float) -> None:
        """See `Interlock.authorise`: the permitted waveform, with zeros after it, once, and no other."""
        permit = self._permit
        allowed = None if permit is None else permit.volts.get(output)
        if (
            permit is None
            or allowed is None
            or output in self._playing
            or rate_hz != permit.rate_hz
            or not np.array_equal(volts[: len(allowed)], allowed)
            or np.any(volts[len(allowed) :])
        ):
            raise self._not_authorised(output)
        if not self._playing:
            self._known(Outputs.start)
        self._playing.add(output)

    def authorise_waveform(self, output: str, waveform: Waveform, starts: bool) -> None:
        """See `Interlock.authorise_waveform`: the permitted waveform, once, and no other."""
        permit = self._permit
        if permit is None or permit.waveforms.get(output) != waveform or output in self._playing:
            raise self._not_authorised(output)
        if starts:
            self._playing.add(output)
        else:
            self._known(Outputs.no_sweep)

    def authorise_patches(self, patches: frozenset[str]) -> None:
        """See `Interlock.authorise_patches`. Opening is always allowed."""
        permit = self._permit
        if not patches:
            return
        if permit is not None and (self._playing or not patches <= permit.patches):
            raise LimitError(
                f"The relay was not switched to {', '.join(sorted(patches))}: a drive is being played into "
                f"{', '.join(sorted(permit.patches))}, and until it has ended the relay only opens."
            )
        self._known(Outputs.rest)
        self._audit.note("connected", patches=sorted(patches))

    def switched(self, patches: frozenset[str]) -> None:
        """See `Interlock.switched`: outside a play, what is closed is watched, and the outputs are held."""
        outputs = self._outputs()
        if outputs is not None and outputs.direct:
            return  # always connected: the watch goes on
        watched = self._watch.on
        self._watch.end()
        if self._permit is not None or self._process != os.getpid():
            return
        if patches:
            self._watch.begin()
            return
        if outputs is not None and watched:
            self._tripping(outputs.left)

    def authorise_renewal(self) -> None:
        """See `Interlock.authorise_renewal`. In a play the abort monitor looks."""
        outputs = self._outputs()
        if outputs is not None and self._permit is None and self._process == os.getpid() and self._watch.on:
            self._tripping(outputs.watch)

    def authorise_release(self) -> None:
        """See `Interlock.authorise_release`."""
        outputs = self._outputs()
        if self._process == os.getpid() and outputs is not None and outputs.in_use:
            error = LimitError(
                "The outputs stay reserved while a drive is played or a patch is connected: another program "
                "could write to them. Disconnect the patch with rig.relay.connect([]) first."
            )
            self._audit.note("refused", why=str(error))
            raise error

    def keep_watch(self) -> None:
        """Look at the outputs from now on: a contact could not be opened."""
        self._watch.end()
        self._watch.begin()

    def _tripping(self, look: Callable[[], None]) -> None:
        """Lock the rig out when volts stand where zero was set, or another program has taken an output."""
        try:
            look()
        except Standing as error:
            self._report(error)
            raise

    def _report(self, error: Standing) -> None:
        """Lock the rig out, unless that was logged just now."""
        if self._lockouts.logged(self._clock.now()):
            self._lose_heat()
        else:
            self.lock_out(str(error))

    def _lose_heat(self) -> None:
        """An actuator that is always connected may have got volts that nobody counted."""
        outputs = self._outputs()
        if outputs is not None and outputs.direct:
            with suppress(DataError):  # kept in memory at least
                self._judge.heat.lose()

    def _known(self, look: Callable[[Outputs], None]) -> None:
        """Look at the outputs, and log why something is not done. Raises InstrumentError."""
        outputs = self._outputs()
        try:
            if outputs is None or self._process != os.getpid():
                raise InstrumentError("The rig was closed: open it again.")
            look(outputs)
        except InstrumentError as error:
            self._audit.note("refused", why=str(error))
            if isinstance(error, Standing):
                self._report(error)
            raise

    def _not_authorised(self, output: str) -> LimitError:
        error = LimitError(
            f"Nothing was played on {output!r}: a rig plays only what its limiter has authorised, so play it "
            "with rig.excite or rig.generate."
        )
        self._audit.note("refused", why=str(error))
        return error

    def _refuse_elsewhere(self, patches: Collection[str], volts: bool) -> None:
        """Refuse volts for other patches than the one that no relay parts from the amplifier."""
        outputs = self._outputs()
        direct = outputs.direct if outputs is not None else frozenset()
        if direct and volts and frozenset(patches) != direct:
            raise LimitError(
                f"What is played reaches {', '.join(sorted(direct))} in any case, because no relay lies "
                "between: name exactly that patch, or play zero volts."
            )

    @contextmanager
    def refusals_noted(self) -> Iterator[None]:
        """Log a LimitError of the context."""
        try:
            yield
        except LimitError as error:
            self._audit.note("refused", why=str(error))
            raise

    @contextmanager
    def _lasting(self, permit: _Permit, seconds: float, heat: Heating, **about: object) -> Iterator[None]:
        with self._lock:
            if self._permit is not None:
                raise LimitError("A drive is being played: wait until it has ended before the next one.")
            self._permit = permit
            self._player = threading.get_ident()
            self._idle.clear()
        self._watch.end()
        begun = self._clock.now()
        try:
            self._audit.note("played", patches=sorted(permit.patches), seconds=seconds, **about)
            self.warm = self._judge.begin(begun, seconds, heat)
            yield
        except BaseException as error:
            if self._playing:
                self._audit.note_at_last("stopped", why=f"{type(error).__name__}: {error}".rstrip(": "))
            raise
        finally:
            self._judge.end(begun, seconds)
            self._permit = None
            self._player = 0
            self._playing.clear()
            self._idle.set()
            outputs = self._outputs()
            if outputs is not None and outputs.direct and self._process == os.getpid():
                self._watch.begin()
            self._judge.keep(heat)
