"""Whether people feel a motion: how far it lies above the threshold of an act, and for what share of them.

Model: the levels of people's thresholds are normal around that of the mean person, who lies on the act's
curve or up to `higher` and `lower` away from it; a person feels what lies above the own threshold. The answer
is of most people: it is known only where both ends say the same. What breaks it: a spread of people that is
not the assumed one, attention, masking by the press itself, and a table that moves otherwise under a finger.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from .thresholds import Act

Answer = Literal["yes", "no", "not known"]
"""Do most people feel it? "yes" if so even with the highest threshold that the act may have, "no" if not even
with the lowest."""


_HARDLY = 0.05
"""Share of people below which a motion counts as felt by nobody."""


@dataclass(frozen=True, eq=False)
class Sensation:
    """A level above the threshold of the mean person in one act, and what people feel of it."""

    act: Act
    level: float
    """dB; minus infinity for no motion."""
    measured: tuple[float, float] | None = None
    """95 % confidence interval of `level`, where it was measured."""

    @property
    def people(self) -> tuple[float, float]:
        """Share of people who feel it, with the highest and with the lowest threshold that may be.

        The ends of the level's interval are part of what may be.
        """
        low, high = self.measured or (self.level, self.level)
        edges = np.array([low - self.act.higher, high + self.act.lower])
        least, most = scipy.special.ndtr(edges / self.act.spread)
        return float(least), float(most)

    @property
    def answer(self) -> Answer:
        """Whether most people feel it."""
        least, most = self.people
        if least >= 0.5:
            return "yes"
        return "no" if most < 0.5 else "not known"

    @property
    def nobody(self) -> bool:
        """True when hardly anybody feels it, even with the lowest threshold that the act may have."""
        return self.people[1] < _HARDLY

    def sentence(self, force: float | None = None) -> str:
        """The answer as one sentence; `force` (N) is that of the press."""
        pressed = f" with {force:.1f} N" if force and force > 0 and self.act.name == "pressing" else ""
        who = f"a person who {self.act.does}{pressed}"
        low, high = self.measured or (self.level, self.level)
        if not np.isfinite(high):
            return f"{_capital(who)} does not feel it: nothing moves between 18 and 1122 Hz."
        # An interval that reaches down to no motion has an upper end only.
        hidden = not np.isfinite(low)
        level = high if hidden else self.level
        side = "above" if level >= 0 else "below"
        at_most = "the laser's noise hides it: at most " if hidden and level >= 0 else ""
        at_least = "the laser's noise hides it: at least " if hidden and level < 0 else ""
        lies = f"{at_most}{at_least}{abs(level):.0f} dB {side} threshold"
        said = f"({lies}; {shares(*self.people)} of people)"
        match self.answer:
            case "yes":
                return f"{_capital(who)} feels it {said}."
            case "no" if self.nobody:
                return f"{_capital(who)} does not feel it {said}."
            case "no":
                return f"{_capital(who)} mostly does not feel it {said}."
            case _:
                return f"Not known whether {who} feels it {said}."

    @property
    def reservation(self) -> str:
        """What the answer rests on, what it would change, and what settles it; one sentence."""
        act = self.act
        if act.mark == "measured":
            return f"The threshold is {act.basis}, known to {act.higher:.0f} dB."
        return (
            f"The threshold of a {act.name} finger is an estimate, {act.basis}: it may lie "
            f"{act.higher:.0f} dB higher or {act.lower:.0f} dB lower, and people differ by "
            f"{act.spread:.0f} dB. A threshold experiment of this lab settles it."
        )


def shares(least: float, most: float) -> str:
    """Two shares of people as a range in whole percent."""
    low, high = _whole(least), _whole(most)
    return f"{low} %" if low == high else f"{low} to {high} %"


def _whole(share: float) -> str:
    percent = round(100 * share)
    return "under 1" if percent < 1 else "over 99" if percent > 99 else str(percent)


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]
