"""Reach a rig's safe state, even when a step fails or hangs, and close its instruments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...base.clock import Clock
from ...base.errors import HaploopError, InstrumentError
from ..interlock import Interlocked
from .audit import Audit
from .deadline import run_within
from .outputs import Outputs, Standing

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
