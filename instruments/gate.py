"""The gate at every output: what puts volts out lets nothing pass that a limiter has not admitted.

A role's public method is a final template that asks the gate and then calls the driver's own,
underscored method. A driver cannot replace the template, and without a rig its gate is closed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from instruments.arrays import FloatArray
from instruments.errors import LimitError

if TYPE_CHECKING:
    from instruments.generator import Sweep

__all__ = ["Gate", "Gated"]


class Gate(Protocol):
    """What a role asks before it does anything that volts at a patch may follow from."""

    def admit(self, output: str, volts: FloatArray, rate_hz: float) -> None:
        """Let `volts` ((samples,) V at the output, at `rate_hz`) pass. Raises LimitError."""

    def admit_sweep(self, output: str, sweep: Sweep, starts: bool) -> None:
        """Let a generator be set to a sweep (V at the output), or start it. Raises LimitError."""

    def admit_patches(self, patches: frozenset[str]) -> None:
        """Let a relay connect patches. Raises LimitError."""


class _Closed:
    """The gate of a driver that belongs to no rig. Its relay may switch: there is nothing to switch."""

    def admit(self, output: str, volts: FloatArray, rate_hz: float) -> None:
        raise _no_limits(output)

    def admit_sweep(self, output: str, sweep: Sweep, starts: bool) -> None:
        raise _no_limits(output)

    def admit_patches(self, patches: frozenset[str]) -> None:
        pass


class Gated:
    """Base of the roles that have a gate. A subclass that replaces a final method is a TypeError."""

    _gate: Gate = _Closed()

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
        "with its excite or sweep."
    )
