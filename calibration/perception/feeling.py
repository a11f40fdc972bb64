"""What people feel of a motion: in each act, its difference from the target, and beside the press.

Whether people feel it (`Sensation`): how far it lies above the threshold of an act, and for what share of
them. Model: the levels of people's thresholds are normal around that of the mean person, who lies on the
act's curve or up to `higher` and `lower` away from it; a person feels what lies above the own threshold. The
answer is of most people: it is known only where both ends say the same. What breaks it: a spread of people
that is not the assumed one, attention, masking by the press itself, and a table that moves otherwise under a
finger.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.wording import capital
from .levels import (
    OCTAVES,
    SHORT,
    Levels,
    decibels,
    levels_of,
    mean_levels,
    pressing,
    resting,
    running_level,
    spans_above,
)
from .thresholds import Act, LabThreshold, pressing_act, thresholds

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
            return f"{capital(who)} does not feel it: nothing moves between 18 and 1122 Hz."
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
                return f"{capital(who)} feels it {said}."
            case "no" if self.nobody:
                return f"{capital(who)} does not feel it {said}."
            case "no":
                return f"{capital(who)} mostly does not feel it {said}."
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


_WORTH_SAYING = 0.1
"""Share of a level in estimated rows of the table above which a sentence says so."""


@dataclass(frozen=True, eq=False)
class Pressed:
    """The press that a motion reproduces."""

    recorded: FloatArray | None = None
    """(samples,) m/s^2 at its own size, on the target's clock."""
    force: float | None = None
    """N, at the activation."""
    lab: LabThreshold | None = None
    """Threshold of the lab's people, in place of the table's."""


@dataclass(frozen=True, eq=False)
class Feeling:
    """What people feel of a measured motion, of its difference from the target, and of the recorded press.

    `bands` of each are (bands,) dB re 1e-6 m/s^2 rms in the third octaves `octaves_hz`. Times are seconds on
    the target's clock.
    """

    octaves_hz: FloatArray
    resting_db: FloatArray
    """(bands,) threshold of a finger at rest, dB re 1e-6 m/s^2 rms."""
    pressing_db: FloatArray
    """(bands,) threshold of a finger that presses."""
    target: Levels
    measured: Levels
    residual: Levels
    """Measured motion less the target."""
    recorded: Levels | None
    """The recorded press, at its own size."""
    force: float | None
    """Force of the press at its activation (N)."""
    acts: tuple[Sensation, ...]
    """What people feel of the measured motion, in each act; the first is pressing."""
    noise: FloatArray | None
    """(bands,) noise of the mean of the plays, over the whole record; dB re 1e-6 m/s^2 rms."""
    noise_total: float
    """Noise of the mean of the plays, dB above the pressing threshold; NaN if not known."""
    rate_hz: float
    measured_level: FloatArray
    """(samples,) dB of the measured motion above the pressing threshold, in 20 ms around each sample."""
    recorded_level: FloatArray | None
    """(samples,) the same of the recorded press."""

    @property
    def pressing(self) -> Sensation:
        """What a person feels who presses: the verdict's."""
        return self.acts[0]

    @property
    def felt(self) -> Answer:
        """Do most people who press feel the measured motion?"""
        return self.pressing.answer

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        return self.pressing.sentence(self.force)

    @property
    def spans(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the measured motion is above the pressing threshold, in windows of 20 ms."""
        return spans_above(self.measured_level >= 0, self.rate_hz)

    @property
    def recorded_spans(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the recorded press is above the pressing threshold."""
        return () if self.recorded_level is None else spans_above(self.recorded_level >= 0, self.rate_hz)

    @property
    def lost(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the recorded press is above that threshold and the measured motion is not."""
        if self.recorded_level is None:
            return ()
        return spans_above((self.recorded_level >= 0) & (self.measured_level < 0), self.rate_hz)

    @property
    def loudness_db(self) -> float:
        """Sensation level of the measured motion over that of the recorded press; NaN without one."""
        if self.recorded is None or not np.isfinite(self.recorded.pressing):
            return float("nan")
        return self.measured.pressing - self.recorded.pressing

    @property
    def comparable(self) -> bool:
        """True when the target is as far above threshold as the just noticeable difference was measured at.

        Below, an error beyond that difference need not be noticed, and nothing is claimed.
        """
        return self.target.pressing >= _noticeable()[1]

    @property
    def ratio(self) -> float:
        """Residual over target, both weighted with the threshold."""
        if not np.isfinite(self.residual.pressing):
            return 0.0
        return float(10 ** ((self.residual.pressing - self.target.pressing) / 20))

    @property
    def difference(self) -> Answer:
        """Would a person who presses feel that measured motion and target differ?

        "no" where hardly anybody would feel the difference by itself, and, where that figure holds, within
        the least just noticeable difference: a residual of some fraction of the amplitude changes the
        amplitude by at most that fraction. "yes" beyond it, where the figure holds and the difference is felt
        by itself, and where there is nothing to compare with. Masking between frequencies is not counted.
        """
        alone, beside = (
            Sensation(self.pressing.act, one.pressing, one.interval) for one in (self.residual, self.target)
        )
        if alone.nobody or (self.comparable and self.ratio <= _noticeable()[0]):
            return "no"
        return "yes" if alone.answer == "yes" and (self.comparable or beside.nobody) else "not known"

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the reader of a result, beside `sentence`."""
        notes = (self.pressing.reservation, _on_estimates(self), _on_press(self), *_on_difference(self))
        return tuple(note for note in notes if note)


def feeling_of(
    target: FloatArray,
    measured: FloatArray,
    rate_hz: float,
    press: Pressed | None = None,
    plays: FloatArray | None = None,
) -> Feeling:
    """Compare accelerations (samples,) m/s^2 with the thresholds of vibrotactile detection.

    `press` is the one that the target reproduces. `plays` (plays, samples) are the single measurements whose
    mean is `measured`: levels are of what they have in common, and their differences give the noise.
    """
    press = press or Pressed()
    recorded, shift = press.recorded, pressing_act(press.lab).shift
    noise, noise_total = _noise(plays, rate_hz)

    each = measured if plays is None else plays
    moved = levels_of(each, rate_hz)

    def levels(signal: FloatArray) -> Levels:
        return levels_of(signal, rate_hz).lowered(shift)

    def running(signal: FloatArray) -> FloatArray:
        return running_level(signal, rate_hz, SHORT) - shift

    return Feeling(
        octaves_hz=OCTAVES,
        resting_db=resting(OCTAVES),
        pressing_db=pressing(OCTAVES) + shift,
        target=levels(target),
        measured=moved.lowered(shift),
        residual=levels(each - target),
        recorded=None if recorded is None else levels(recorded),
        force=press.force,
        acts=sensations_of(moved, press.lab),
        noise=noise,
        noise_total=noise_total - shift,
        rate_hz=rate_hz,
        measured_level=running(each),
        recorded_level=None if recorded is None else running(recorded),
    )


def sensations_of(levels: Levels, lab: LabThreshold | None = None) -> tuple[Sensation, ...]:
    """What people feel of a motion in each act; the first is pressing, by the lab's threshold if any."""
    pressed, *others = thresholds().acts
    act = pressing_act(lab)
    assert pressed.name == act.name
    own = levels.lowered(act.shift)
    return Sensation(act, own.pressing, own.interval), *(Sensation(one, levels.resting) for one in others)


def _noise(plays: FloatArray | None, rate_hz: float) -> tuple[FloatArray | None, float]:
    """Noise of the mean over the whole record: (bands,) dB re 1e-6 m/s^2 rms, and dB above threshold."""
    if plays is None or len(plays) < 2:
        return None, float("nan")
    each = [mean_levels(play - plays.mean(axis=0), rate_hz) for play in plays]
    # Standard error of the mean: n residuals share n - 1 degrees of freedom.
    share = 1 / (len(plays) * (len(plays) - 1))
    bands = share * np.sum([10 ** (bands / 10) for bands, _ in each], axis=0)
    total = share * sum(10 ** (total / 10) for _, total in each)
    return 10 * np.log10(np.maximum(bands, 1e-30)), decibels(total)


def _noticeable() -> tuple[float, float]:
    """Least just noticeable difference (fraction), and the dB above threshold at which it was measured."""
    least = min(thresholds().differences, key=lambda d: d.fraction)
    return least.fraction, least.sensation


def _on_estimates(feeling: Feeling) -> str:
    if feeling.measured.estimated <= _WORTH_SAYING:
        return ""
    return (
        f"{feeling.measured.estimated:.0%} of that level comes from above "
        f"{feeling.pressing.act.curve.found_to_hz:.0f} Hz, where the form of the threshold is estimated too."
    )


def _on_press(feeling: Feeling) -> str:
    """How much of the press is lost, in time."""
    if not feeling.recorded_spans:
        return ""
    wanted, lost = _duration(feeling.recorded_spans), _duration(feeling.lost)
    if not feeling.lost:
        return f"All {1e3 * wanted:.0f} ms of the press that are above that threshold stay above it."
    return (
        f"Of the {1e3 * wanted:.0f} ms in which the recorded press is above that threshold, the motion is "
        f"above it for {1e3 * (wanted - lost):.0f} ms (in windows of {1e3 * SHORT:.0f} ms)."
    )


def _on_difference(feeling: Feeling) -> tuple[str, ...]:
    (low, high), (fraction, sensation) = feeling.residual.interval, _noticeable()
    if not np.isfinite(high):
        return ("There is no difference from the target.",)
    if not np.isfinite(low):
        most = 10 ** ((high - feeling.target.pressing) / 20)
        return (
            f"The difference from the target is at most {most:.0%} of it as it is felt, and no larger than "
            "the noise of the plays.",
        )
    share = f"The difference from the target is {feeling.ratio:.0%} of it as it is felt"
    if feeling.comparable:
        side = "within" if feeling.ratio <= fraction else "beyond"
        felt = {"no": "it is not felt", "yes": "it is felt", "not known": "it may be felt"}[
            feeling.difference
        ]
        said = f"{share}, {side} the least just noticeable difference, {fraction:.0%}: {felt}."
    elif feeling.difference == "no":
        said = f"{share}, and too weak to be felt by itself."
    elif feeling.difference == "yes":
        said = f"{share}, and is felt by itself: the target is not."
    else:
        said = (
            f"{share}; just noticeable differences were measured {sensation:.0f} dB above threshold, and the "
            "target is not as far above it: nothing is claimed."
        )
    return (said,)


def _duration(spans: tuple[tuple[float, float], ...]) -> float:
    return sum(end - begin for begin, end in spans)
