"""Drives of one press for fingers of different force, of which one is chosen by the force, and their checks.

A finger that presses harder damps the table more, and a drive made for another force is wrong by what that
changes. By the law of the force (`haploop.calibration.model.finger`) one calibrated finger tells the response
at any force; drives are made for a light, a nominal and a firm one, all of the same scale, so that a press is
as loud whichever is chosen. Chosen is the nearest on the scale on which the finger's impedance grows evenly.
What breaks it: a force that changes during a play, and a finger that does not follow the law.

In a check under a finger the drive is played, and the surface measured, while a fingertip rests on it. The
laser must see the point under the finger, from the other side of the pane. The comparison is that of any
check, with the target of the drive: what the finger does to the table is not computed, it is there. That it
is there is measured as well: by the force sensor where it carries the table, and otherwise by the response,
which a finger changes, before and after the plays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...acquisition import Representative, refuse_name
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.notebook import InNotebook
from ...base.progress import Progress, silent
from ...instruments import Limits, Rig
from ...instruments.operator import RestFinger
from ..band import BAND
from ..model import GROWS, Calibration, Finger, at_force
from ..response import Response, quick_response
from ..resting_finger import FORCES, LEAST, TableForce, refuse_force, resting
from .check import check
from .checked import Check
from .drive import Drive, drive_for
from .planning import TRADE_OFF, TradeOff
from .playing import refuse_foreign
from .targets import Method

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
    trade: TradeOff = TRADE_OFF,
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
            "Drives for a finger need calibrations under one person's finger (haploop calibrate-finger)."
        )
    nominal = held[0].force
    least, most = FORCES
    forces = tuple(dict.fromkeys(min(max(share * nominal, least), most) for share in _OVER_NOMINAL))
    loaded = [tuple(at_force(one, force) for one in calibrations) for force in forces]

    def planned(own: Sequence[Calibration], trade: TradeOff) -> Drive:
        return drive_for(press, own, limits, method=method, trade=trade)

    # The firm finger takes most volts: what is within reach under it sets the scale of all.
    drives = [planned(loaded[-1], trade)]
    for own in reversed(loaded[:-1]):
        drives.insert(0, planned(own, replace(trade, error=None, scale=drives[-1].scale)))
    lowest = min(one.scale for one in drives)
    if lowest < (1 - _ONE_SCALE) * drives[-1].scale:
        drives = [planned(own, replace(trade, error=None, scale=lowest)) for own in loaded]
    return PressedDrives(held[0].participant, nominal, forces, tuple(drives))


_CHANGED = 0.015
"""Relative change of the response below which nothing rests on the table: two looks at the same one differ by
up to 0.005 (simulated), and 0.25 N on the paper's pane change it by 0.03 and more."""


def check_under_finger(
    rig: Rig,
    drive: Drive | PressedDrives,
    participant: str,
    *,
    force: float = 1.0,
    plays: int = 8,
    made_for: Finger | None = None,
    progress: Progress = silent,
) -> Check:
    """Check a drive while a participant's fingertip rests at its point with about a force (N).

    The operator is asked to rest it, and to lift it when the plays are over, however they end. Of
    `PressedDrives` the one is checked that the force calls for, by the force sensor where it carries the
    table, or the nominal one; `made_for` is the finger that a single drive was made for. The verdict is of
    the motion under the finger, and says so in its notes. Raises ConfigurationError for a force that is none,
    InstrumentError when nobody rests a finger or it leaves before the plays are over, and what `check`
    raises.
    """
    refuse_name(participant)
    refuse_force(force)
    if plays < 3:
        raise ConfigurationError("A check needs at least 3 plays: their differences are its uncertainty.")
    one = drive if isinstance(drive, Drive) else drive.drives[0]
    refuse_foreign(rig, one)  # before somebody rests a finger
    asked = RestFinger(participant, one.point, force)
    presence = _Presence(rig, asked, one.patches[0])
    with resting(rig, asked):
        felt = presence.found()
        chosen, told = (drive, "") if isinstance(drive, Drive) else drive.chosen(felt)
        result = check(rig, chosen, plays=plays, most=plays, progress=progress)  # nobody holds still for long
        presence.refuse_left()
    under = f"Measured under {participant}'s fingertip, which was asked to rest with {force:g} N."
    notes = [under, told] if told else [under]
    if isinstance(drive, PressedDrives) and drive.participant != participant:
        notes.append(f"The drive was made for {drive.participant}'s finger.")
    if made_for is not None and (made_for.participant, made_for.force) != (participant, force):
        notes.append(f"The drive was made for {made_for.participant}'s finger at {made_for.force:.3g} N.")
    return replace(result, notes=(*notes, *result.notes))


class _Presence:
    """Whether a finger rests on the table. Made before it comes."""

    def __init__(self, rig: Rig, asked: RestFinger, patch: str) -> None:
        self._rig, self._asked, self._patch = rig, asked, patch
        self._weighed = TableForce.at_rest(rig)
        self._looks = [] if self._weighed else [self._look()]

    def _look(self) -> Response:
        return quick_response(self._rig, self._patch, self._asked.point)

    def found(self) -> float | None:
        """The force (N) of the finger; None without a sensor. Raises InstrumentError when none is there."""
        if self._weighed is not None:
            return self._weighed.found(self._asked)
        self._looks.append(self._look())
        if (changed := _change(*self._looks)) < _CHANGED:
            raise InstrumentError(
                f"Nobody rests a finger at the {self._asked.point} point: the response changed by "
                f"{changed:.1%} only. {self._asked.participant} must be there, and the table be free before."
            )
        return None

    def refuse_left(self) -> None:
        """Raise InstrumentError when the finger is no longer there."""
        if self._weighed is not None:
            left = self._weighed.read() < LEAST
        else:
            now = self._look()
            bare, under = (_change(one, now) for one in self._looks)
            left = bare < under
        if left:
            raise InstrumentError(
                f"{self._asked.participant}'s finger left the table before the plays were over: rest it "
                "until you are asked to lift it."
            )


def _change(before: Response, after: Response) -> float:
    """Relative rms change of a response within the band of drives."""
    f = before.frequencies
    inside = (f >= BAND[0]) & (f <= BAND[1])
    one, other = before.velocity[inside], np.interp(f[inside], after.frequencies, after.velocity)
    return float(np.linalg.norm(other - one) / np.linalg.norm(one))
