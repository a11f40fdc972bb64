"""The outputs that can reach a relay: at zero volts, and known to be, before a contact closes.

Another program, a person at a front panel, or a program that was killed may have left volts on an output.
Whoever closes a contact lets them through.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import HaploopError, InstrumentError

__all__ = ["Outputs"]

_ZERO = 0.02
"""Largest volts that count as zero where an output is read back (V): ten times the offset error of a card's
own channel for it, and 1 V at a patch behind a gain of 50."""


class Outputs:
    """The outputs of a rig's instruments, by role; `instruments` may grow until the rig is open."""

    def __init__(self, instruments: Mapping[str, Any]) -> None:
        self._instruments = instruments

    def rest(self) -> None:
        """Set every output that can reach the relay to zero, and read it back.

        A DAQ reads its outputs back as far as its cards can. A generator that is on is refused and not
        switched off: somebody may be using it. A player stops; what another program plays on the same
        sound card is not seen before the drive monitor shows it.

        Raises InstrumentError for an output that is not at zero, or that cannot be known to be: a generator
        that is on, or a DAQ's output that another program holds.
        """
        self.no_sweep()
        player = self._wired("player")
        try:
            if player is not None:
                player.stop()
            daq = self._instruments["daq"]
            daq.zero()
            standing = daq.outputs_read()
        except HaploopError as error:
            raise InstrumentError(
                "The relay stays open, because an output that leads to it is not known to be at zero volts: "
                f"{error}"
            ) from error
        for output, volts in standing.items():
            if not abs(volts) <= _ZERO:
                raise InstrumentError(
                    f"The relay stays open, because the output {output!r} was set to zero and reads "
                    f"{volts:.3g} V: look for another program that uses the card, and for a wire from "
                    "another output."
                )

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
        return instrument if instrument.output in fed else None
