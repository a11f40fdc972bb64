"""One factor over a whole response: what a laser's scale, a patch's strength or the drive monitor does.

A drift moves poles, and residues stay: a table whose boundary, temperature or damping changed answers each
mode with the strength that it had. A laser that is aimed askew (by the cosine of the angle), or has another
range or scale, multiplies every mode by the same real number; so does a patch that is depolarised or came
unglued. No response tells the two apart, and only one of them moves the table: adopted as a drift, a laser's
factor would leave every button wrong by it. So both are named, with what speaks for either, and a person
decides. The amplifier is not among them, because the volts at the patch are measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .drift import Verdict
from .history import Generation, History
from .look import Place


def common_factors(
    verdicts: Sequence[Verdict], since: Mapping[Place, float], accepted: float
) -> tuple[str, ...]:
    """Sentences on places whose factor is beyond what is accepted (relative); empty when there are none.

    `since` holds the factors that earlier recalibrations have adopted: see `factors_since`.
    """
    measured = [v for v in verdicts if v.now is not None]
    factors = {(v.patch, v.point): v.factor * since.get((v.patch, v.point), 1.0) for v in measured}
    told = []
    for v in measured:
        place = v.patch, v.point
        factor = factors[place]
        if abs(factor - 1) <= accepted:
            continue
        if abs(factor * v.path - 1) <= accepted:
            told.append(
                f"The drive monitor shows {v.path:.2f} times the volts that it showed for the same command "
                f"at patch {v.patch}, and the table moves as it did: check the monitor's divider and cable."
            )
            continue
        told.append(
            f"Every mode of patch {v.patch} at the {v.point} point moves {factor:.2f} times as much for each "
            "volt at the patch as when it was calibrated, which no drift of the table does: either the "
            f"laser's scale is wrong (its aim{_angle(factor)}, range or settings), or the patch's strength "
            f"changed (depolarised, cracked or unglued). {_evidence(place, factors, accepted)}"
        )
    if told:
        told.append(
            "Nothing is made anew, because a wrong scale would make every button wrong by it. Aim the laser "
            "square to the surface, check its range, and recalibrate; if the factor stays, the patch has "
            "changed: calibrate it, make its buttons and adopt them."
        )
    return tuple(told)


def factors_since(history: History, active: Generation) -> dict[Place, float]:
    """By place: product of the factors adopted by recalibrations since a person adopted its calibration.

    So a laser that tilts a little every night is found as well as one that was pushed.
    """
    factors: dict[Place, float] = {}
    settled: set[Place] = set()
    generation = active
    while generation.parent:
        parent = history.find(generation.parent)
        places = {(one["patch"], one["point"]): one for one in generation.details.get("places", ())}
        for name in generation.files:
            if name.startswith("calibrations/") and generation.files[name] != parent.files.get(name):
                patch, point = name.removeprefix("calibrations/").removesuffix(".h5").split("-", 1)
                if (patch, point) not in places:
                    settled.add((patch, point))
        for place, one in places.items():
            if place not in settled:
                factors[place] = factors.get(place, 1.0) * float(one["factor"])
        generation = parent
    return factors


def _angle(factor: float) -> str:
    return f", by {np.degrees(np.arccos(factor)):.0f}° if that is all" if factor < 1 else ""


def _evidence(place: Place, factors: Mapping[Place, float], accepted: float) -> str:
    """What the other places say about laser and patch."""
    patch, point = place
    others = {other: factor for other, factor in factors.items() if other[0] != patch}
    if not others:
        return "Only one patch was measured, so that the response cannot tell which."
    alike = [other for other, factor in others.items() if abs(factor / factors[place] - 1) <= accepted]
    if len(alike) == len(others):
        return "All patches that were measured changed alike, which speaks for the laser."
    as_before = sorted(
        other[0] for other, factor in others.items() if other[1] == point and abs(factor - 1) <= accepted
    )
    if as_before:
        return (
            f"Seen at the same point, patch {', '.join(as_before)} is as it was, which speaks for the patch."
        )
    return "The other patches do not tell which."
