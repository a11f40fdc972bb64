"""Something that rests on the table, told from a drift by what it does to the modes' damping.

A finger, a palm or a thing that is left on the table takes energy out of every mode, of each as its shape is
at that place: some modes are damped a lot more, others hardly, and none is damped less. A drift moves
frequencies, or changes all dampings by one factor, or some up and others down. So where dampings have risen
by unlike amounts, and none has fallen by a comparable one, something may rest on the table. A boundary that
damps some modes more does the same. No response tells the two apart; a person can, so that one is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..band import BAND
from ..model import Model
from .overlay import Overlay

if TYPE_CHECKING:
    from .drift import Verdict


_LEAST = 0.01
"""Rise of a mode's damping ratio (logarithm), beyond what the fit leaves open and beyond the least of the
modes, from which it is one: 1 % of a resonance's height."""
_CLEAR = 7.0
"""Least rise over the fit's residual: where modes drift by 1 to 3 % each the fit may not find all of them,
and what it leaves is no noise: then a mode seemed to rise by up to 5.2 of it."""
_FALL, _NOISE = 0.3, 0.01
"""Largest fall of another mode's, over the rise, and beside it, with which it may still be a body: under
hands none fell by more than 0.008."""
_UNLIKE = 0.5
"""Least difference between modes, over the largest rise: under hands it was 0.63 and more. A change of all
dampings alike has none, and a drift of all frequencies, which seems to damp by 0.8 of itself, up to 0.42."""
_EDGE = 0.02
"""Distance from the band's upper edge, over it, within which a mode is not looked at: half of its resonance
was not measured, and a drift takes it out of the band or brings another in."""
_SEEN = 0.05
"""Peak of a resonance, over the strongest of the band, from which its damping is known well enough."""
TAKE_AWAY = (
    "Take hands and things off the table, and run it again. If nothing is on it, run it with somebody there "
    "who confirms that (--attended): the dampings then count as a drift."
)


@dataclass(frozen=True)
class Dampings:
    """How the dampings of the modes of a place changed."""

    changes: tuple[float, ...] = (0.0,)
    """Logarithm of each mode's factor."""
    unsure: tuple[float, ...] = (0.0,)
    """How far the fit leaves each of them open."""
    left: float = 0.0
    """Residual of that fit."""

    @property
    def risen(self) -> float:
        """Change of the mode that rose most, beyond what the fit leaves open."""
        return max(zip(self.changes, self.unsure, strict=True), key=lambda mode: mode[0] - mode[1])[0]

    @property
    def lowest(self) -> float:
        """Least change."""
        return min(self.changes)

    @property
    def touched(self) -> bool:
        """True when a body that rests on the table explains them, and one factor does not."""
        rise, lowest = self.risen, self.lowest
        sure = max(change - unsure for change, unsure in zip(self.changes, self.unsure, strict=True))
        clear = sure - max(lowest, 0.0) > _LEAST and rise > _CLEAR * self.left
        return clear and rise - lowest > _UNLIKE * rise and -lowest < _FALL * rise + _NOISE

    @property
    def inverse(self) -> Dampings:
        """The change back."""
        return replace(self, changes=tuple(-change for change in self.changes))


def dampings_of(model: Model, laid: Overlay) -> Dampings:
    """Changes of damping of a model's modes, by what was laid over them."""
    weight = laid.weight
    hz = np.abs(model.poles) / (2 * np.pi)
    highest = np.maximum(hz, hz * (1 + laid.shift))
    inside = (hz > BAND[0]) & (highest < (1 - _EDGE) * BAND[1]) & (model.poles.imag > 0)
    if not inside.any():
        return Dampings()
    known = inside & (weight > _SEEN * weight[inside].max())
    changes, unsure = np.log(laid.dampings[known]), laid.unsure[known]
    return Dampings(tuple(changes.tolist()), tuple(unsure.tolist()), laid.left)


def told_touched(verdicts: Sequence[Verdict]) -> tuple[str, ...]:
    """A sentence for each place at which something seems to rest on the table."""
    return tuple(
        f"Something seems to rest on the table: seen by patch {one.patch} at the {one.point} point, the "
        f"dampings of its modes changed by {np.expm1(one.dampings.lowest):+z.0%} to "
        f"{np.expm1(one.dampings.risen):+z.0%}, as a finger or a palm changes them, and a drift hardly."
        for one in verdicts
        if one.dampings.touched
    )
