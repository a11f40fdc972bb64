"""The interlock at every output: an instrument puts out only what a limiter has authorised.

Model: volts reach a patch through one of few acts, each of one role: a DAQ streams a waveform, a player or
a generator starts one, a relay closes. A role's public method for such an act is a final template that asks
the interlock and then calls the driver's own, underscored method. A driver cannot replace the template, and
without a rig its interlock refuses. The limiter authorises what it has judged whole, sample by sample, and
nothing else.

Assumptions: a driver puts out volts in those methods only, and what it was given; the program does not
reach for underscored names. What breaks them, and what looks after it: a driver that does more (the
conformance suite, and the read-back of outputs), another program or a person at the front panel
(`safety/outputs.py` looks before a contact closes, and the abort monitor while it is closed), a killed
program (the relay's dead-man). See docs/explanation/safety.md.
"""

from __future__ import annotations

from typing import Any, Protocol

from ..base.arrays import FloatArray
from ..base.errors import ConfigurationError, LimitError
from .waveforms import Waveform


class Interlock(Protocol):
    """Authorises every action of a role that can put volts on a patch."""

    def authorise(self, output: str, volts: FloatArray, rate_hz: float) -> None:
        """Allow `volts` ((samples,) V at the output, at `rate_hz`). Raises LimitError."""

    def authorise_waveform(self, output: str, waveform: Waveform, starts: bool) -> None:
        """Allow a generator to be set to a waveform (V at the output), or to start it. Raises LimitError."""

    def authorise_patches(self, patches: frozenset[str]) -> None:
        """Allow a relay to connect patches, and bring to zero what leads to them. Raises LimitError."""

    def switched(self, patches: frozenset[str]) -> None:
        """Exactly these patches read connected now. Raises InstrumentError where volts stand on an output."""

    def authorise_release(self) -> None:
        """Allow other programs to write to the outputs. Raises LimitError while a contact may be closed."""

    def authorise_renewal(self) -> None:
        """Look at what stands on a connected patch before it stays connected. Raises InstrumentError."""


class _NoRig:
    """Interlock of a driver without a rig: refuses volts, and lets a relay only open."""

    def authorise(self, output: str, volts: FloatArray, rate_hz: float) -> None:
        raise _no_limits(output)

    def authorise_waveform(self, output: str, waveform: Waveform, starts: bool) -> None:
        raise _no_limits(output)

    def authorise_patches(self, patches: frozenset[str]) -> None:
        if patches:
            raise LimitError(
                f"Patch {', '.join(sorted(patches))} is not connected without a rig, which knows what "
                "stands on the amplifier's input: open the rig with open_rig, and use its relay."
            )

    def switched(self, patches: frozenset[str]) -> None:
        pass

    def authorise_release(self) -> None:
        pass

    def authorise_renewal(self) -> None:
        pass


class Interlocked:
    """Base of the roles that have an interlock. A subclass that replaces a final method is a TypeError."""

    _interlock: Interlock = _NoRig()
    _shown: frozenset[str] = frozenset()
    """Its data under public names when a rig took it over."""

    def __setattr__(self, name: str, value: object) -> None:
        # A driver of another package may work with what it shows; a test may replace a method.
        if name in self._shown and not callable(value):
            raise ConfigurationError(
                f"{name!r} of an open rig's {type(self).__name__} is not assigned to: change the rig file, "
                "and open the rig again."
            )
        super().__setattr__(name, value)

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        for name in vars(cls):
            for base in cls.__mro__[1:]:
                if getattr(vars(base).get(name), "__final__", False):
                    raise TypeError(
                        f"{cls.__name__} replaces {base.__name__}.{name}, which holds what is played to the "
                        f"rig's limits: write _{name} instead."
                    )


def _no_limits(output: str) -> LimitError:
    return LimitError(
        f"Nothing is played on {output!r} without a rig's limits: open the rig with open_rig, and play "
        "with its excite or generate."
    )
