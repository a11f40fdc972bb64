"""A detection threshold that a lab measured with its own people, in place of the table's estimate.

Model: in a staircase on one digital button the amplitude of its drive was varied; the motion at a person's
threshold is that of the check, times the amplitude. Its level above the table's curve for a finger that
presses is that person's threshold; the mean over people shifts the curve, and their standard deviation is the
spread. What breaks it: a button of another spectrum than the one that was played, as far as the form of the
curve is an estimate; another force; people unlike those who took part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ...base.errors import ConfigurationError
from .thresholds import Act, thresholds

if TYPE_CHECKING:
    from ...instruments import Rig


@dataclass(frozen=True)
class LabThreshold:
    """The threshold of a lab's people; see the module."""

    people: int
    shift: float
    """Threshold of the mean person over the table's curve for a finger that presses (dB)."""
    uncertainty: float
    """Half of its interval of 95 % (dB)."""
    spread: float
    """Standard deviation between people (dB), the scatter of the experiment included."""
    button: str
    """Button that was played."""
    force: float
    """Force at its activation (N); NaN if not measured."""
    simulated: bool
    """True when simulated participants answered."""


def pressing_act(lab: LabThreshold | None) -> Act:
    """The act of a finger that presses, by the lab's threshold or else by the table."""
    act = thresholds().act("pressing")
    if lab is None:
        return act
    force = f" at {lab.force:.1f} N" if lab.force > 0 else ""
    who = "simulated participants" if lab.simulated else "people"
    return replace(
        act,
        shift=lab.shift,
        higher=lab.uncertainty,
        lower=lab.uncertainty,
        spread=lab.spread,
        mark="measured",
        basis=f"that of {lab.people} {who} of this lab, measured with its {lab.button} button{force}",
    )


def lab_threshold(rig: Rig) -> LabThreshold | None:
    """The threshold in a rig's file, in its table `[people]`; None without one.

    Raises ConfigurationError for simulated people on a real rig.
    """
    people = rig.file.people
    if people is None:
        return None
    if people.simulated and not rig.simulated:
        raise ConfigurationError(
            f"The [people] of the rig file of {rig.name!r} are simulated participants, and the rig is real: "
            "take the table out, or measure a threshold with people."
        )
    return LabThreshold(
        people=people.number,
        shift=people.threshold,
        uncertainty=people.uncertainty,
        spread=people.spread,
        button=people.button,
        force=math.nan if people.force is None else people.force,
        simulated=people.simulated,
    )
