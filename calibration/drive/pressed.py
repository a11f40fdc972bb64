"""Drives of one press for fingers of different force: the one that is played is chosen by the force.

A finger that presses harder damps the table more, and a drive made for another force is wrong by what that
changes. By the law of the force (`haploop.calibration.model.finger`) one calibrated finger tells the response
at any force; drives are made for a light, a nominal and a firm one, all of the same scale, so that a press is
as loud whichever is chosen. Chosen is the nearest on the scale on which the finger's impedance grows evenly.
What breaks it: a force that changes during a play, and a finger that does not follow the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...acquisition import Representative
from ...base.errors import ConfigurationError, DataError
from ...base.notebook import InNotebook
from ...instruments import Limits
from ..model import GROWS, Calibration, at_force
from ..resting_finger import FORCES
from .drive import Drive, drive_for
from .targets import Method
from .trade import TRADE, Trade

_OVER_NOMINAL = (0.4, 1.0, 3.0)
"""Forces of a light, a nominal and a firm finger, over the one that the finger was calibrated with: with 1 N,
presses from 0.25 to 5 N have a drive that is made for an impedance within a fifth of theirs. No force is
beyond those of a fingertip that rests."""

_ONE_SCALE = 0.01
"""Relative difference of scales that nobody feels: a twentieth of what is just noticed."""


@dataclass(frozen=True, eq=False)
class PressedDrives(InNotebook):
    """Drives of one press under one person's finger, for rising forces. See the module."""

    participant: str
    nominal: float
    """Force (N) of the drive that is played where no force sensor sees the finger."""
    forces: tuple[float, ...]
    """N, rising."""
    drives: tuple[Drive, ...]
    """One for each force."""

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for drives that nobody made."""
        rising = all(
            0 < one < other for one, other in zip(self.forces, (*self.forces[1:], np.inf), strict=True)
        )
        if not rising or len(self.drives) != len(self.forces) or self.nominal not in self.forces:
            raise DataError(
                "the drives for a finger do not have one force each, rising, the nominal among them."
            )
        if len({(one.button, one.patches, one.point, one.rig) for one in self.drives}) > 1:
            raise DataError("the drives for a finger are of several buttons.")

    def __repr__(self) -> str:
        return f"<PressedDrives {self.drives[0].button} under {self.participant}'s finger: {self._told}>"

    @property
    def _told(self) -> str:
        return f"{', '.join(f'{force:.3g}' for force in self.forces)} N"

    def number(self, force: float | None) -> int:
        """The number of the drive for a force (N) that was measured, or for the nominal one."""
        asked = self.nominal if force is None else max(force, self.forces[0])
        grown = np.asarray(self.forces) ** GROWS
        return int(np.argmin(np.abs(grown - asked**GROWS)))

    def chosen(self, force: float | None) -> tuple[Drive, str]:
        """The drive for a measured force (N), and a sentence that says which; None without a force sensor."""
        number = self.number(force)
        drive, made_for = self.drives[number], f"the drive for {self.forces[number]:.3g} N of {self._told}"
        if force is None:
            return drive, f"No force sensor carries the table: {made_for}, the nominal one, was played."
        return drive, f"The force sensor read {force:.2f} N before the plays: {made_for} was played."

    def replaced(self, drives: Sequence[Drive]) -> PressedDrives:
        """The same with other drives."""
        return replace(self, drives=tuple(drives))


def pressed_drives(
    press: Representative,
    fingers: Calibration | Sequence[Calibration],
    limits: Limits,
    *,
    method: Method = "modulated",
    trade: Trade = TRADE,
) -> PressedDrives:
    """Make the drives of a press for a light, a nominal and a firm finger.

    `fingers` is the calibration for a finger, or several, of several patches. The nominal force is that of
    the calibration. Raises ConfigurationError for calibrations of the bare table or of several people, and
    what `drive_for` raises.
    """
    calibrations = (fingers,) if isinstance(fingers, Calibration) else tuple(fingers)
    held = [one.finger for one in calibrations if one.finger is not None]
    if len(held) < len(calibrations) or len({one.participant for one in held}) != 1:
        raise ConfigurationError(
            "Drives for a finger need calibrations under one person's finger (haploop calibrate --finger)."
        )
    nominal = held[0].force
    least, most = FORCES
    forces = tuple(dict.fromkeys(min(max(share * nominal, least), most) for share in _OVER_NOMINAL))
    loaded = [tuple(at_force(one, force) for one in calibrations) for force in forces]

    def planned(own: Sequence[Calibration], trade: Trade) -> Drive:
        return drive_for(press, own, limits, method=method, trade=trade)

    # The firm finger takes most volts: what is within reach under it sets the scale of all.
    drives = [planned(loaded[-1], trade)]
    for own in reversed(loaded[:-1]):
        drives.insert(0, planned(own, replace(trade, error=None, scale=drives[-1].scale)))
    lowest = min(one.scale for one in drives)
    if lowest < (1 - _ONE_SCALE) * drives[-1].scale:
        drives = [planned(own, replace(trade, error=None, scale=lowest)) for own in loaded]
    return PressedDrives(held[0].participant, nominal, forces, tuple(drives))
