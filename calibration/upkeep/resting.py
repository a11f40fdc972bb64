"""Something that rests on the table, told from a drift by what it does to the modes' damping.

A finger, a palm or a thing that is left on the table takes energy out of every mode, of each as its shape is
at that place: some modes are damped a lot more, others hardly, and none is damped less. A drift moves
frequencies, or changes all dampings by one factor, or some up and others down. So where dampings have risen
by unlike amounts, and none has fallen by a comparable one, something may rest on the table. A boundary that
damps some modes more does the same. No response tells the two apart; a person can, so that one is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..drive import BAND
from ..model import Model
from .overlay import Overlay

if TYPE_CHECKING:
    from .drift import Verdict

__all__ = ["TAKE_AWAY", "Dampings", "dampings_of", "told_touched"]

_LEAST = 0.01
"""Rise of a mode's damping ratio (logarithm) from which it is one: 1 % of a resonance's height. Tables as
they were, with three times the noise, hum or a wider hysteresis seem damped by up to 0.3 % (simulated)."""
_CLEAR = 5.0
"""The same over the fit's residual: modes that drift by 1 to 3 % each seem damped by up to 5.2 times it, and
fingers and palms damp by 7.5 times it and more (168 hands and 32 such drifts on eight simulated tables), but
for two that changed the response by 0.3 %."""
_FALL, _NOISE = 0.3, 0.01
"""Largest fall of another mode's, over the largest rise, and beside it, with which it may still be a body."""
_UNLIKE = 0.5
"""Least difference between modes, over the largest rise: under hands it was 0.63 and more. A change of all
dampings alike has none, and a drift of all frequencies, which seems to damp by 0.8 of itself, up to 0.42."""
_SEEN = 0.05
"""Peak of a resonance, over the strongest of the band, from which its damping is known well enough."""
TAKE_AWAY = (
    "Take hands and things off the table, and run it again. If nothing is on it, run it with somebody there "
    "who confirms that (--attended): the dampings then count as a drift."
)


@dataclass(frozen=True)
class Dampings:
    """How the dampings of the modes of a place changed: logarithms of the largest and the least factor."""

    highest: float = 0.0
    lowest: float = 0.0
    left: float = 0.0
    """Residual of the fit that told them."""

    @property
    def touched(self) -> bool:
        """True when a body that rests on the table explains them, and one factor does not."""
        rise, fall = self.highest, max(-self.lowest, 0.0)
        clear = rise > max(_LEAST, _CLEAR * self.left)
        return clear and fall < _FALL * rise + _NOISE and self.highest - self.lowest > _UNLIKE * rise

    @property
    def inverse(self) -> Dampings:
        """The change back."""
        return Dampings(-self.lowest, -self.highest, self.left)


def dampings_of(model: Model, laid: Overlay) -> Dampings:
    """Changes of damping of a model's modes, by what was laid over them."""
    weight = laid.weight
    hz = np.abs(model.poles) / (2 * np.pi)
    inside = (hz > BAND[0]) & (hz < BAND[1]) & (model.poles.imag > 0)
    if not inside.any():
        return Dampings()
    known = inside & (weight > _SEEN * weight[inside].max())
    changes = np.log(laid.dampings[known])
    return Dampings(float(changes.max()), float(changes.min()), laid.left)


def told_touched(verdicts: Sequence[Verdict]) -> tuple[str, ...]:
    """A sentence for each place at which something seems to rest on the table."""
    return tuple(
        f"Something seems to rest on the table: seen by patch {one.patch} at the {one.point} point, the "
        f"dampings of its modes changed by {np.expm1(one.dampings.lowest):+.0%} to "
        f"{np.expm1(one.dampings.highest):+.0%}, as a finger or a palm changes them, and a drift hardly."
        for one in verdicts
        if one.dampings.touched
    )
