"""The threshold of a lab's people, from a staircase on one of its digital buttons."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

import numpy as np
import scipy

from ...base.errors import DataError
from ...calibration import DigitalButton
from ...calibration.perception import LabThreshold, levels_of
from .threshold import Threshold

_LEAST_PEOPLE = 3


def lab_threshold_of(
    found: Sequence[Threshold], button: DigitalButton, *, simulated: bool | None = False
) -> LabThreshold:
    """The threshold of the people whose thresholds of a button's amplitude were `found`.

    Those whose answers show none are left out. Raises DataError for fewer than three people with one, several
    thresholds of one, a standard that is not zero, and a button whose motion the table of thresholds does not
    cover.
    """
    left_out = [one for one in found if one.why_none]
    found = [one for one in found if not one.why_none]
    people = [one.who for one in found]
    if len(people) < _LEAST_PEOPLE or len(set(people)) < len(people):
        raise DataError(
            f"There are {len(people)} thresholds of {len(set(people))} people: a lab's threshold needs one "
            f"each of at least {_LEAST_PEOPLE} people.{_said(left_out)}"
        )
    if any(one.standard not in (None, 0.0) for one in found):
        raise DataError(
            "The thresholds are of differences from a standard: a detection threshold has the standard 0."
        )
    amplitudes = np.array([one.threshold for one in found])
    check = button.check
    whole = levels_of(check.accelerations, check.rate_hz).pressing
    if not (np.all(amplitudes > 0) and math.isfinite(whole)):
        raise DataError("A threshold of amplitude is above 0, and the button moves between 18 and 1122 Hz.")
    levels = whole + 20 * np.log10(amplitudes)
    count = len(levels)
    spread = float(levels.std(ddof=1))
    force = button.press.force
    return LabThreshold(
        people=count,
        shift=float(levels.mean()),
        uncertainty=float(scipy.special.stdtrit(count - 1, 0.975)) * spread / count**0.5,
        spread=spread,
        button=button.press.button,
        force=math.nan if force is None else float(force[button.press.activation_index]),
        simulated=bool(simulated) or button.simulated,
    )


def _said(left_out: Sequence[Threshold]) -> str:
    return "".join(f" {' '.join(one.who)} has none: {one.why_none}." for one in left_out)


def people_table(lab: LabThreshold) -> str:
    """The table of a rig file that states a lab's threshold, as TOML."""
    lines = [
        "[people]",
        f"number = {lab.people}",
        f"threshold = {lab.shift:.1f}      # dB over the table's for a finger that presses",
        f"uncertainty = {max(lab.uncertainty, 0.1):.1f}    # dB, half of its interval of 95 %",
        f"spread = {max(lab.spread, 0.1):.1f}         # dB, standard deviation between people",
        f"button = {json.dumps(lab.button, ensure_ascii=False)}",
    ]
    if lab.force > 0:
        lines.append(f"force = {lab.force:.1f}          # N")
    if lab.simulated:
        lines.append("simulated = true")
    return "\n".join(lines) + "\n"
