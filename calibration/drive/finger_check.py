"""A check under a finger: the drive is played, and the surface measured, while a fingertip rests on it.

The laser must see the point under the finger, from the other side of the pane. The comparison is that of any
check, with the target of the drive: what the finger does to the table is not computed, it is there.
"""

from __future__ import annotations

from dataclasses import replace

from ...instruments import ConfigurationError, InstrumentError, Rig
from ...instruments.operator import LiftFinger, RestFinger
from ...instruments.progress import Progress, silent
from .check import check
from .checked import Check
from .drive import Drive

__all__ = ["check_under_finger"]

_COMES = 0.5
"""Time (s) that a finger gets to come to rest, or to leave."""


def check_under_finger(
    rig: Rig,
    drive: Drive,
    participant: str,
    *,
    force: float = 1.0,
    plays: int = 8,
    progress: Progress = silent,
) -> Check:
    """Check a drive while a participant's fingertip rests at its point with about a force (N).

    The operator is asked to rest it, and to lift it when the plays are over, however they end. The verdict is
    of the motion under the finger, and says so in its notes. Raises ConfigurationError for a force that is
    none, InstrumentError when nobody rests a finger, and what `check` raises.
    """
    if not 0 < force <= 20:
        raise ConfigurationError(f"A fingertip rests with more than 0 and up to 20 N, not with {force:g} N.")
    if not rig.operator.confirm(RestFinger(participant, drive.point, force)):
        raise InstrumentError(
            f"Nobody rests a finger at the {drive.point} point: {participant} has to be there."
        )
    try:
        rig.clock.sleep(_COMES)
        result = check(rig, drive, plays=plays, progress=progress)
    finally:
        rig.operator.confirm(LiftFinger())
        rig.clock.sleep(_COMES)
    told = f"Measured under {participant}'s fingertip, which was asked to rest with {force:g} N."
    return replace(result, notes=(told, *result.notes))
