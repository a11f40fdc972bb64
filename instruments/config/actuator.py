"""The `[actuator]` table: what is glued to each of the table's patches, and what it takes.

A patch is a driven place of the table; the actuator is the thing that drives it. All patches of a table have
actuators of one kind.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from ...base.bounded import Finite, NotNegative, NotPositive, Positive, Strict
from ..limits import Coil, Limits

_KEYS = {"piezo": ("capacitance", "min", "max"), "coil": ("resistance", "volts", "watts", "thermal_time")}
"""Keys that a kind needs."""
_OTHERS = {"piezo": (), "coil": ("inductance", "force_factor")}
_WHAT = {"piezo": "a piezo patch", "coil": "a coil"}


def _protects(text: str) -> str:
    if re.match(r"\W*(no|none|nothing|nobody|nix|not)\b", text, re.IGNORECASE):
        raise ValueError(
            f"{text!r} protects nothing: name the fuse, resistor or limiter, or leave the key out, and set "
            "an amplifier that puts out no more than the actuator takes"
        )
    return text


class Actuator(Strict):
    """The actuator of each patch. `piezo`: patch, bender or stack. `coil`: voice coil, exciter or LRA."""

    kind: Literal["piezo", "coil"]
    capacitance: Annotated[float, Field(strict=True, ge=1e-12, le=1e-3)] | None = None
    """piezo: F. The largest stacks have some tens of µF."""
    min: NotPositive | None = None
    """piezo: lowest voltage (V); 0 for one that takes no negative voltage."""
    max: Positive | None = None
    """piezo: highest voltage (V)."""
    resistance: Positive | None = None
    """coil: DC resistance (ohm)."""
    inductance: NotNegative | None = None
    """coil: H. Without it the current is judged by the resistance alone, which is never less strict."""
    volts: Positive | None = None
    """coil: largest voltage of either sign (V)."""
    watts: Positive | None = None
    """coil: power that it may dissipate for ever (W)."""
    thermal_time: Annotated[float, Field(strict=True, gt=0, le=600)] | None = None
    """coil: thermal time constant of its winding (s)."""
    force_factor: Finite | None = None
    """coil: N per A, of the simulated one only (1 without it; docs/hardware.md, "Coils")."""
    name: Annotated[str, Field(max_length=60)] = ""
    """Product, for people."""
    source: Annotated[str, Field(max_length=200)] = ""
    """Where its figures are from."""
    protected_by: (
        Annotated[str, Field(min_length=5, max_length=200, pattern=r"\S"), AfterValidator(_protects)] | None
    ) = None
    """What keeps it whole when the amplifier puts out all that it can, such as a fuse: `wiring = "direct"`
    asks for it when that is more than the actuator takes."""

    @model_validator(mode="after")
    def _of_one_kind(self) -> Self:
        missing = [key for key in _KEYS[self.kind] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"{_WHAT[self.kind]} needs {', '.join(missing)}: add it to [actuator]")
        (other,) = {"piezo", "coil"} - {self.kind}
        foreign = [k for k in (*_KEYS[other], *_OTHERS[other]) if getattr(self, k) is not None]
        if foreign:
            raise ValueError(
                f"{_WHAT[self.kind]} has no {foreign[0]}, which is a key of {_WHAT[other]}: remove it, or "
                f'write kind = "{other}"'
            )
        if self.watts is not None and self.watts > self._largest():
            raise ValueError(
                f"at volts = {self.volts:g} into {self.resistance:g} ohm it can dissipate "
                f"{self._largest():.3g} W at most, and watts = {self.watts:g} is more: write watts in W, "
                "volts as a peak"
            )
        return self

    @property
    def peak(self) -> float:
        """Largest voltage of either sign that it takes (V)."""
        return self.volts if self.volts is not None else max(self.max or 0.0, -(self.min or 0.0))

    @property
    def pole_hz(self) -> float | None:
        """Corner of a coil's current (Hz): R / (2 pi L). None without an inductance."""
        if not self.resistance or not self.inductance:
            return None
        return self.resistance / (2 * math.pi * self.inductance)

    def limits(self, patches: int) -> Limits:
        """Limits of so many in parallel, all with the same volts."""
        if self.kind == "coil":
            assert self.volts and self.resistance and self.watts and self.thermal_time
            each, count = self.inductance or 0.0, max(patches, 1)
            coil = Coil(self.resistance / count, each / count, self.thermal_time)
            return Limits(min=-self.volts, max=self.volts, coil=coil, power=count * self.watts)
        assert self.min is not None and self.max and self.capacitance
        return Limits(min=self.min, max=self.max, capacitance=patches * self.capacitance)

    def held_watts(self, volts: float) -> float:
        """What a voltage that stays makes a coil dissipate (W); 0 of a piezo patch."""
        return volts**2 / self.resistance if self.resistance else 0.0

    def _largest(self) -> float:
        return self.held_watts(self.volts or 0.0)
