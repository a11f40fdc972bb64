"""A check under a finger: the drive is played, and the surface measured, while a fingertip rests on it.

The laser must see the point under the finger, from the other side of the pane. The comparison is that of any
check, with the target of the drive: what the finger does to the table is not computed, it is there. That it
is there is measured as well: by the force sensor where it carries the table, and otherwise by the response,
which a finger changes, before and after the plays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...acquisition import refuse_name
from ...base.errors import ConfigurationError, InstrumentError
from ...base.progress import Progress, silent
from ...instruments import Rig
from ...instruments.operator import RestFinger
from ..band import BAND
from ..model import Finger
from ..response import Response, quick_response
from ..resting_finger import LEAST, TableForce, refuse_force, resting
from .check import check
from .checked import Check
from .drive import Drive
from .playing import refuse_foreign
from .pressed import PressedDrives

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
