"""What a finger would feel: how far a motion, and its difference from the target, lie above threshold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...instruments.arrays import FloatArray
from .levels import (
    LONG,
    OCTAVES,
    SHORT,
    Levels,
    decibels,
    levels_of,
    mean_levels,
    resting,
    running_level,
    sensitive,
    spans_above,
)
from .thresholds import thresholds

__all__ = ["Answer", "Feeling", "feeling_of"]

Answer = Literal["yes", "perhaps", "no"]
"""Answer by the table of thresholds: "yes" above that of a finger at rest, "no" below everything in it, also
below what is only recalled of fingers that press hard."""

_CLOSE_TO_NOISE = 3.0
"""Level of a residual over that of the noise (dB) below which it may be noise alone."""
_WORTH_SAYING = 0.1
"""Share of a level in estimated rows of the table above which a sentence says so."""
_NAMED = 4
"""Parts of a press that a sentence names."""


@dataclass(frozen=True, eq=False)
class Feeling:
    """Sensation levels of target, measured motion, their difference, and of the recorded press.

    Each is a pair: the loudest 100 ms and the loudest 20 ms. `bands` are (bands,) dB re 1e-6 m/s^2 rms in
    the third octaves `octaves_hz`; levels named `total` are dB above the threshold of a large contact at
    rest. Times are seconds on the target's clock.
    """

    octaves_hz: FloatArray
    resting_db: FloatArray
    """(bands,) threshold of a large contact at rest, dB re 1e-6 m/s^2 rms."""
    sensitive_db: FloatArray
    """(bands,) lowest threshold of the table, dB re 1e-6 m/s^2 rms."""
    target: tuple[Levels, Levels]
    measured: tuple[Levels, Levels]
    residual: tuple[Levels, Levels]
    """Measured motion less the target."""
    recorded: tuple[Levels, Levels] | None
    """The recorded press, at its own size."""
    noise: FloatArray | None
    """(bands,) noise of the mean of the plays, over the whole record; dB re 1e-6 m/s^2 rms."""
    noise_total: float
    """Noise of the mean of the plays, dB above the resting threshold; NaN if not known."""
    rate_hz: float
    measured_level: FloatArray
    """(samples,) dB of the measured motion above the resting threshold, in 20 ms around each sample."""
    sensitive_level: FloatArray
    """(samples,) the same above the lowest threshold of the table."""
    recorded_level: FloatArray | None
    """(samples,) dB of the recorded press above the resting threshold, in 20 ms around each sample."""

    @property
    def spans(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the measured motion is above the resting threshold."""
        return spans_above(self.measured_level >= 0, self.rate_hz)

    @property
    def sensitive_spans(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the measured motion is above the lowest threshold of the table."""
        return spans_above(self.sensitive_level >= 0, self.rate_hz)

    @property
    def recorded_spans(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the recorded press is above the resting threshold."""
        return () if self.recorded_level is None else spans_above(self.recorded_level >= 0, self.rate_hz)

    @property
    def lost(self) -> tuple[tuple[float, float], ...]:
        """Parts in which the recorded press is above the resting threshold and the measured motion is not."""
        if self.recorded_level is None:
            return ()
        return spans_above((self.recorded_level >= 0) & (self.measured_level < 0), self.rate_hz)

    @property
    def felt(self) -> Answer:
        """Answer to: can the measured motion be felt at all? By the loudest 100 ms."""
        return _answer(self.measured[0])

    @property
    def loudness_db(self) -> float:
        """Sensation level of the measured motion over that of the recorded press; NaN without one."""
        if self.recorded is None or not np.isfinite(self.recorded[0].total):
            return float("nan")
        return self.measured[0].total - self.recorded[0].total

    @property
    def comparable(self) -> bool:
        """True when the target is as far above threshold as the just noticeable difference was measured at.

        Below, an error beyond that difference need not be noticed, and nothing is claimed.
        """
        return self.target[0].total >= _noticeable()[1]

    @property
    def difference(self) -> Answer:
        """Answer to: would a person feel that measured motion and target differ? By the loudest 100 ms.

        "no" below everything in the table, and, where that figure holds, within the least just noticeable
        difference: a residual of some fraction of the amplitude changes the amplitude by at most that
        fraction. "yes" beyond it, where the figure holds, and where there is nothing to compare with.
        Masking between frequencies is not counted.
        """
        alone = _answer(self.residual[0])
        if alone == "no" or (self.comparable and self.ratio <= _noticeable()[0]):
            return "no"
        return "yes" if alone == "yes" and (self.comparable or _answer(self.target[0]) == "no") else "perhaps"

    @property
    def ratio(self) -> float:
        """Residual over target, both weighted with the threshold, in the loudest 100 ms of each."""
        if not np.isfinite(self.residual[0].total):
            return 0.0
        return float(10 ** ((self.residual[0].total - self.target[0].total) / 20))

    @property
    def warning(self) -> str:
        """Sentence for a verdict, if the motion may not be felt or is too weak to judge its error; or ""."""
        if self.felt != "yes":
            return _on_level(self)[0]
        fraction, sensation = _noticeable()
        if self.comparable:
            return ""
        return (
            f"The target lies {_above(self.target[0].total)} the threshold of a finger at rest: a just "
            f"noticeable difference of {fraction:.0%} was measured at {sensation:.0f} dB, and is larger "
            "nearer to threshold."
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the reader of a result."""
        return tuple(note for note in (*_on_level(self), *_on_press(self), *_on_difference(self)) if note)


def feeling_of(
    target: FloatArray,
    measured: FloatArray,
    rate_hz: float,
    recorded: FloatArray | None = None,
    plays: FloatArray | None = None,
) -> Feeling:
    """Compare accelerations (samples,) m/s^2 with the thresholds of vibrotactile detection.

    `recorded` is the press that the target reproduces, at its own size and on the target's clock. `plays`
    (plays, samples) are the single measurements whose mean is `measured`: their differences give the noise.
    """
    residual = measured - target
    noise, noise_total = _noise(plays, rate_hz)
    return Feeling(
        octaves_hz=OCTAVES,
        resting_db=resting(OCTAVES),
        sensitive_db=sensitive(OCTAVES),
        target=_both(target, rate_hz),
        measured=_both(measured, rate_hz),
        residual=_both(residual, rate_hz),
        recorded=None if recorded is None else _both(recorded, rate_hz),
        noise=noise,
        noise_total=noise_total,
        rate_hz=rate_hz,
        measured_level=running_level(measured, rate_hz, SHORT),
        sensitive_level=running_level(measured, rate_hz, SHORT, sensitive),
        recorded_level=None if recorded is None else running_level(recorded, rate_hz, SHORT),
    )


def _both(signal: FloatArray, rate_hz: float) -> tuple[Levels, Levels]:
    return levels_of(signal, rate_hz, LONG), levels_of(signal, rate_hz, SHORT)


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


def _answer(level: Levels) -> Answer:
    if level.total >= 0:
        return "yes"
    return "perhaps" if level.sensitive >= thresholds().pressing else "no"


def _noticeable() -> tuple[float, float]:
    """Least just noticeable difference (fraction), and the dB above threshold at which it was measured."""
    least = min(thresholds().differences, key=lambda d: d.fraction)
    return least.fraction, least.sensation


def _on_level(feeling: Feeling) -> tuple[str, ...]:
    long, table = feeling.measured[0], thresholds()
    if not np.isfinite(long.total):
        return ("The measured motion has no part between 18 and 1122 Hz: nothing can be felt.",)
    resting = (
        f"The loudest {1e3 * LONG:.0f} ms of the measured motion lie {_above(long.total)} the threshold of "
        "detection of a finger at rest"
    )
    lowest = f"{_above(long.sensitive)} the lowest curve of the table ({table.gripping.contact})"
    hard = f"only what is {table.pressing_mark} of fingers that press hard lies lower"
    if feeling.felt == "yes":
        said = f"{resting}: the motion can be felt."
    elif feeling.felt == "no":
        said = f"{resting} and {lowest}: nothing can be felt."
    elif long.sensitive >= 0:
        said = f"{resting}, but {lowest}: it can perhaps be felt by a finger that presses."
    else:
        said = f"{resting} and {lowest}; {hard}: it is unlikely to be felt."
    spread = (
        f"People differ by about {table.spread:.0f} dB (one standard deviation, {table.spread_mark}), so "
        "that some feel it and some do not."
    )
    estimated = (
        f"{long.estimated:.0%} of that level comes from above {table.resting.found_to_hz:.0f} Hz, where the "
        "threshold is an estimate."
    )
    near = min(abs(long.total), abs(long.sensitive)) <= table.spread
    return said, spread if near else "", estimated if long.estimated > _WORTH_SAYING else ""


def _on_press(feeling: Feeling) -> tuple[str, ...]:
    if feeling.recorded is None:
        return ()
    wanted, lost = _duration(feeling.recorded_spans), _duration(feeling.lost)
    recorded = (
        f"The recorded press is above the threshold of a finger at rest for {1e3 * wanted:.0f} ms (in "
        f"windows of {1e3 * SHORT:.0f} ms)"
    )
    if not feeling.recorded_spans:
        kept = "The recorded press itself is below the threshold of a finger at rest throughout."
    elif not feeling.lost:
        kept = f"{recorded}, and the measured motion for all of it."
    elif not feeling.spans:
        kept = (
            f"{recorded}, and the measured motion never; it is above the lowest curve for "
            f"{1e3 * _duration(feeling.sensitive_spans):.0f} ms."
        )
    else:
        parts = ", ".join(f"{1e3 * a:.0f} to {1e3 * b:.0f} ms" for a, b in feeling.lost[:_NAMED])
        more = ", and more" if len(feeling.lost) > _NAMED else ""
        kept = f"{recorded}, and for {1e3 * lost:.0f} ms of it the measured motion is below: {parts}{more}."
    loudness = feeling.loudness_db
    compared = (
        f"The measured motion is {abs(loudness):.1f} dB {'quieter' if loudness < 0 else 'louder'} than the "
        "recorded press, both weighted with the threshold."
    )
    return kept, compared if np.isfinite(loudness) else ""


def _on_difference(feeling: Feeling) -> tuple[str, ...]:
    level, (fraction, sensation) = feeling.residual[0], _noticeable()
    if not np.isfinite(level.total):
        return ("There is no difference from the target.",)
    said = f"The difference from the target lies {_above(level.total)} the threshold of a finger at rest"
    share = f"is {feeling.ratio:.0%} of the target as it is felt"
    least = f"the least just noticeable difference of amplitude, {fraction:.0%}"
    if feeling.comparable and feeling.ratio <= fraction:
        said += f" and {share}, within {least}: it is not felt."
    elif feeling.difference == "no":
        said += " and below everything in the table: it is not felt."
    elif feeling.comparable:
        said += f" and {share}, beyond {least}: it {'is' if feeling.difference == 'yes' else 'may be'} felt."
    elif feeling.difference == "yes":
        said += ", and the target below everything in the table: it is felt by itself."
    else:
        said += (
            f" and {share}. The target lies {_above(feeling.target[0].total)} that threshold, and {least}, "
            f"was measured {sensation:.0f} dB above it: nothing is claimed."
        )
    noisy = level.total < feeling.noise_total + _CLOSE_TO_NOISE
    return said, "That difference is no larger than the noise of the plays." if noisy else ""


def _above(level: float) -> str:
    return f"{abs(level):.1f} dB {'above' if level >= 0 else 'below'}"


def _duration(spans: tuple[tuple[float, float], ...]) -> float:
    return sum(end - begin for begin, end in spans)
