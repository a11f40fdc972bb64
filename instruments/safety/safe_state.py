"""The safe state of a rig, reached whatever fails or hangs; and the closing of its instruments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from haploop.instruments.clock import Clock
from haploop.instruments.errors import HaploopError, InstrumentError
from haploop.instruments.safety.audit import Audit
from haploop.instruments.safety.deadline import run_within

__all__ = ["SafeState"]

_REST = 0.05
"""Seconds of zero drive before the relay switches: several time constants of the amplifier."""


class SafeState:
    """The safe state of these instruments, by role. One that has hung is not waited for again."""

    def __init__(self, instruments: Mapping[str, Any], clock: Clock, audit: Audit) -> None:
        self._instruments = instruments
        self._clock = clock
        self._audit = audit
        self._hung: set[str] = set()

    def reach(self) -> None:
        """See `Rig.make_safe`."""
        failures = []
        steps: tuple[tuple[str, Callable[[Any], object]], ...] = (
            ("player", lambda player: player.stop()),
            ("daq", lambda daq: daq.zero()),
            ("generator", lambda generator: generator.off()),
            *((role, lambda other: other.make_safe()) for role in self._others()),
            ("relay", lambda _: self._clock.sleep(_REST)),
            ("relay", lambda relay: relay.connect(())),
        )
        for role, step in steps:
            if role not in self._instruments:
                continue
            try:
                self._run_within(role, step)
            except Exception as error:
                failures.append(error)
        if failures:
            why = " ".join(str(failure) for failure in failures)
            self._audit.note_at_last("unsafe", why=why)
            raise InstrumentError(
                f"The safe state was not confirmed: {why} Switch the amplifier off by hand."
            ) from failures[0]

    def _others(self) -> list[str]:
        """Roles of other packages that have a safe state."""
        return [role for role, instrument in self._instruments.items() if hasattr(instrument, "make_safe")]

    def let_go(self, role: str) -> None:
        """Close an instrument. Raises InstrumentError when it hangs, and what its `close` raises."""
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
        name = f"The {role} ({getattr(instrument, 'identity', '')})"
        if role in self._hung:
            raise InstrumentError(f"{name} still hangs.")
        try:
            run_within(name, lambda: step(instrument))
        except TimeoutError as error:
            self._hung.add(role)
            raise InstrumentError(str(error)) from None
