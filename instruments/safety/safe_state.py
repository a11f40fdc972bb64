"""Reach a rig's safe state, even when a step fails or hangs: its outputs, its contacts, its instruments."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from ...base.clock import Clock
from ...base.errors import HaploopError, InstrumentError, TakenError
from ...base.wording import capital
from ..interlock import Interlocked
from .audit import Audit
from .deadline import run_within

# The outputs that can reach a relay: at zero volts, and known to be, while a contact is closed.
#
# Another program, a person at a front panel, or a program that was killed may have left volts on an output.
# Whoever closes a contact lets them through. From before it closes until it reads open again, the outputs are
# reserved, so that no other program can write to them.

_ZERO = 0.02
"""Largest volts that count as zero where an output is read back (V): ten times the offset error of a card's
own channel for it, and 1 V at a patch behind a gain of 50."""


class Standing(InstrumentError):  # noqa: N818
    """Volts stand on an output that was set to zero."""


class Outputs:
    """The outputs of a rig's instruments, by role; `instruments` may grow until the rig is open.

    `direct` are patches that no relay parts from the amplifier: for them the outputs stay reserved as long as
    the rig is open.
    """

    def __init__(self, instruments: Mapping[str, Any], direct: Collection[str] = ()) -> None:
        self._instruments = instruments
        self.direct = frozenset(direct)
        self._fed: dict[str, bool] = {}
        self.in_use = False
        """True from when a contact was allowed to close, or a drive to start, until the outputs are free."""

    def rest(self) -> None:
        """Set every output that can reach the relay to zero, keep it reserved, and read it back.

        A DAQ reads its outputs back as far as its cards can. A generator that is on is refused and not
        switched off: somebody may be using it. A player stops; what another program plays on the same
        sound card is not seen before the drive monitor shows it.

        Raises InstrumentError for an output that is not at zero, or that cannot be known to be: a generator
        that is on, or a DAQ's output that another program holds. Then nothing stays reserved.
        """
        self.no_sweep()
        player, daq = self._wired("player"), self._instruments["daq"]
        then = "The actuator is always connected, and" if self.direct else "The relay stays open, because"
        try:
            try:
                if player is not None:
                    player.stop()
                self.hold()
                standing = self._standing()
            except HaploopError as error:
                kind = Standing if isinstance(error, Standing) else InstrumentError
                raise kind(
                    f"{then} an output that leads to it is not known to be at zero volts: {error}"
                ) from error
            if standing:
                kind = Standing if self.direct and self.in_use else InstrumentError
                raise kind(f"{then} {standing}")
            self.in_use = True
        except InstrumentError:
            with suppress(HaploopError):
                daq.let_go()
            raise

    def hold(self) -> None:
        """Set the DAQ's outputs to zero and keep them reserved. Raises InstrumentError.

        It is Standing where another program has taken them, and where they lead to an actuator that is always
        connected, and have been at zero before.
        """
        try:
            self._instruments["daq"].hold()
        except TakenError as error:
            raise Standing(f"A patch may have got volts: {error}") from error
        except HaploopError as error:
            if self.direct and self.in_use:
                raise Standing(f"The actuator may have got volts: {error}") from error
            raise

    def start(self) -> None:
        """Note that a drive starts. Raises InstrumentError for a generator that is on."""
        self.no_sweep()
        self.in_use = True

    def found(self) -> dict[str, float]:
        """Volts on outputs that are not at zero, as far as they can be read. Raises InstrumentError."""
        read = self._instruments["daq"].outputs_read()
        return {name: float(volts) for name, volts in read.items() if not abs(volts) <= _ZERO}

    def at_actuator(self, found: Mapping[str, float]) -> float:
        """Largest volts that so many on outputs make at an actuator that is always connected (V)."""
        amplifier = self._instruments["amplifier"]
        rails, gained = amplifier.limits(1), abs(1 / float(amplifier.to_input(np.ones(1))[0]))
        return float(min(gained * max(map(abs, found.values())), max(rails.max, -rails.min)))

    def watch(self) -> None:
        """Look whether the outputs that lead to a closed contact still rest, and are still reserved.

        Raises Standing; every contact has been told to open by then.
        """
        daq = self._instruments["daq"]
        try:
            self.no_sweep()
            standing = self._standing()
            if standing:
                raise InstrumentError(standing)
            daq.hold()
        except HaploopError as error:
            generator = self._wired("generator") if self.direct else None
            off = () if generator is None else (generator.off,)
            for step in (*off, daq.hold, lambda: self._instruments["relay"].connect(())):
                with suppress(HaploopError):
                    step()
            raise Standing(f"A patch was connected, and may have got volts: {error}") from error

    def left(self) -> None:
        """Free the outputs, once no contact is closed: not those of an actuator that always is.

        Raises InstrumentError when one is not at zero.

        It is Standing when they were in use meanwhile, and when another program has taken them.
        """
        standing = self._standing()
        was, self.in_use = self.in_use, bool(self.direct)
        try:
            self.hold()
        finally:
            if not self.direct:
                self._instruments["daq"].let_go()
        if standing and was:
            raise Standing(f"A patch may have got volts before its contact opened, because {standing}")
        if standing:
            raise InstrumentError(capital(standing))

    def _standing(self) -> str:
        """What stands on an output that was set to zero; "" without any."""
        for output, volts in self._instruments["daq"].outputs_read().items():
            if not abs(volts) <= _ZERO:
                return (
                    f"the output {output!r} was set to zero and reads {volts:.3g} V: look for another "
                    "program that uses the card, and for a wire from another output."
                )
        return ""

    def no_sweep(self) -> None:
        """Raise InstrumentError when a generator that feeds the amplifier is on."""
        generator = self._wired("generator")
        if generator is not None and generator.is_on:
            raise InstrumentError(
                f"{generator.identity} is on, and this rig has not started it: see who uses it, and switch "
                "its output off."
            )

    def _wired(self, role: str) -> Any:
        """The instrument of a role whose output feeds the amplifier, as far as the rig file says; or None."""
        instrument, amplifier = self._instruments.get(role), self._instruments.get("amplifier")
        if instrument is None or amplifier is None:
            return instrument
        fed = set(amplifier.inputs.values()) or {amplifier.input}
        return instrument if self._fed.setdefault(role, instrument.output in fed) else None

    def read_wiring(self) -> None:
        """Read which instruments feed the amplifier: later nobody is asked."""
        for role in ("player", "generator"):
            self._wired(role)


_REST = 0.05
"""Zero drive before the relay switches (s): several time constants of the amplifier (docs/hardware.md,
"Amplifier")."""


class SafeState:
    """Brings instruments, by role, to their safe state. One that has hung is not tried again."""

    def __init__(
        self,
        instruments: Mapping[str, Any],
        clock: Clock,
        audit: Audit,
        outputs: Outputs,
        lock_out: Callable[[str], object],
        keep_watch: Callable[[], object],
    ) -> None:
        """`lock_out` is called with what stands on an output that was set to zero, `keep_watch` when a relay
        did not open.
        """
        self._instruments = instruments
        self._outputs = outputs
        self._lock_out = lock_out
        self._keep_watch = keep_watch
        self._clock = clock
        self._audit = audit
        self._hung: set[str] = set()
        self._names: dict[str, str] = {}

    def adopt(self, role: str) -> None:
        """Note the name of an instrument while it answers: on the way out, asking it may hang."""
        self._names[role] = f"The {role} ({getattr(self._instruments[role], 'identity', '')})"

    def reach(self) -> None:
        """See `Rig.make_safe`."""
        failures = []
        steps: tuple[tuple[str, Callable[[Any], object]], ...] = (
            ("player", lambda player: player.stop()),
            # Held from here until every contact reads open: nobody else writes to an output meanwhile.
            ("daq", lambda _: self._outputs.hold()),
            ("generator", lambda generator: generator.off()),
            *((role, _make_safe) for role in self._others(volts=True)),
            ("relay", lambda _: self._clock.sleep(_REST)),
            ("relay", lambda relay: relay.connect(())),
            ("daq", lambda _: self._outputs.left()),
            # What puts out no volts comes last: if it hangs, it keeps no relay closed.
            *((role, _make_safe) for role in self._others(volts=False)),
        )
        opened = True
        for role, step in steps:
            if role not in self._instruments:
                continue
            if role == "daq" and not opened:  # the outputs stay held: a contact may be closed
                continue
            try:
                self._run_within(role, step)
            except Exception as error:
                failures.append(error)
                opened &= role != "relay"
                if isinstance(error, Standing):
                    self._lock_out(str(error))
        if not opened:
            self._keep_watch()
        if failures:
            why = " ".join(str(failure) or f"{type(failure).__name__}." for failure in failures)
            self._audit.note_at_last("unsafe", why=why)
            raise InstrumentError(
                f"The safe state was not confirmed: {why} Switch the amplifier off by hand."
            ) from failures[0]

    def _others(self, volts: bool) -> list[str]:
        """Roles without a step of their own: those that put out volts, or those that do not."""
        own = ("player", "daq", "generator", "relay")
        return [
            r for r, i in self._instruments.items() if r not in own and isinstance(i, Interlocked) == volts
        ]

    def let_go(self, role: str) -> None:
        """Close an instrument. Raises InstrumentError when it hangs or cannot be closed."""
        if role in self._hung:
            return
        try:
            self._run_within(role, lambda instrument: instrument.close())
        except HaploopError:
            raise
        except Exception as error:
            raise InstrumentError(f"The {role} was not closed ({type(error).__name__}: {error}).") from error

    def _run_within(self, role: str, step: Callable[[Any], object]) -> None:
        instrument = self._instruments[role]
        name = self._names.get(role, f"The {role}")
        if role in self._hung:
            raise InstrumentError(f"{name} still hangs.")
        try:
            run_within(name, lambda: step(instrument))
        except TimeoutError as error:
            self._hung.add(role)
            raise InstrumentError(str(error)) from None


def _make_safe(instrument: Any) -> None:
    """The safe state of an instrument that has one. Looked up here, because that may fail or hang too."""
    getattr(instrument, "make_safe", lambda: None)()
