"""Psychometric functions and staircases, fitted by psignifit, and the threshold of a lab's people.

psignifit states a threshold for whatever answers it gets: its prior keeps the threshold near the compared
values, so that guesses, falling answers and answers that are all right have one too, with a finite interval
and mostly without a warning (4.3: 0.88, -0.01 and -0.03 for 25 answers at each of 0.1, 0.2, 0.4 and 0.8).
So a threshold is stated only where the answers show that there is one: they are better than chance, they do
not fall, and the threshold is one of the values that were compared.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ...base.arrays import FloatArray, IntArray
from ...base.entry_points import optional
from ...base.errors import DataError
from ...calibration import DigitalButton
from ...calibration.perception import LabThreshold, levels_of
from .table import Rows

_LEAST_TRIALS = 20
_LEVEL = 0.05
"""Of both tests: one in twenty of those who guess passes the first."""
_GUESSERS = 4000
"""Simulated people who guess, from whom the first test has its distribution."""


@dataclass(frozen=True)
class Threshold:
    """Psychometric function of one participant, or of one and the levels of further columns."""

    who: tuple[str, ...]
    threshold: float
    """Compared value at which the answers are right half of the way from chance to the lapse rate; NaN, as
    interval, width and lapse are, where the answers show no threshold."""
    interval: tuple[float, float]
    """95 %, Bayesian (Schuett, Harmeling, Macke and Wichmann, 2016)."""
    width: float
    """Width of the function, in the unit of the value."""
    lapse: float
    trials: int
    standard: float | None = None
    """Value that the others were compared with; None when the table does not state it."""
    why_none: str = ""
    """Why the answers show no threshold, without the person's name; empty where they show one."""

    @property
    def difference(self) -> float | None:
        """Just noticeable difference: from the standard to the threshold; None without either."""
        return None if self.standard is None or self.why_none else abs(self.threshold - self.standard)


def analyse_thresholds(rows: Rows, by: tuple[str, ...] = ()) -> tuple[Threshold, ...]:
    """Fit the answers of each participant (and of each level of the columns `by`).

    Lines have `comparison` (the value) and `correct` (true or false); chance is one half. Answers that show
    no threshold (see the module) have a `Threshold` that says why. With
    `first_value` and `second_value`, the other of the two is the standard. Raises ConfigurationError without
    psignifit, DataError: a missing column, fewer than 20 trials, fewer than two values, values on both sides
    of the standard.

    For example:

        >>> from haploop import experiments
        >>> path = experiments.new_experiment("two-interval", "two-interval")
        >>> store = experiments.Store(experiments.load_experiment("two-interval"), "two-interval/answers")
        >>> somebody = haploop.mocks.SimulatedParticipant(haploop.mocks.ParticipantModel(), "P01", 1)
        >>> with experiments.open_session(store, "P01", haploop.RealClock(), simulated=True) as session:
        ...     experiments.run_session(session, somebody)
        >>> answers = experiments.export_answers(store, "two-interval.csv")
        >>> (threshold,) = experiments.analyse_thresholds(experiments.read_rows("two-interval.csv"))
    """
    rows.require("comparison", "correct")
    columns = tuple(name for name in ("participant", *by) if name in rows.columns)
    rows.require(*by)
    psignifit = optional("psignifit", "psychometrics", "An analysis of thresholds")
    values, right = rows.numbers("comparison"), rows.truths("correct")
    keys: list[tuple[str, ...]] = [()] * len(values)
    if columns:
        keys = list(zip(*(rows.text(column) for column in columns), strict=True))
    standards = _standards(rows, values)
    found = []
    for key in dict.fromkeys(keys):
        mine = [index for index, one in enumerate(keys) if one == key]
        of_mine = {standards[index] for index in mine} if standards else set()
        standard = of_mine.pop() if len(of_mine) == 1 else None
        chosen = [(values[index], right[index]) for index in mine]
        found.append(_fit(psignifit, key, chosen, rows.name, standard))
    return tuple(found)


def _standards(rows: Rows, values: list[float]) -> list[float]:
    """The other value of each trial; empty when the table does not have both."""
    if not {"first_value", "second_value"} <= set(rows.columns):
        return []
    both = zip(values, rows.numbers("first_value"), rows.numbers("second_value"), strict=True)
    return [second if value == first else first for value, first, second in both]


def _fit(
    library: Any, who: tuple[str, ...], trials: list[tuple[float, bool]], name: str, standard: float | None
) -> Threshold:
    levels = sorted({value for value, _ in trials})
    called = " ".join(who) or name
    if standard is not None and levels[0] < standard < levels[-1]:
        raise DataError(
            f"{called} has values on both sides of the standard, {standard:g}, and each side has a threshold "
            "of its own: analyse a table of one side, then of the other."
        )
    # Below the standard the answers become right as the value falls.
    sign = -1 if standard is not None and levels[0] < standard else 1
    if len(trials) < _LEAST_TRIALS or len(levels) < 2:
        raise DataError(
            f"{called} has {len(trials)} trials at {len(levels)} values: a threshold needs "
            f"{_LEAST_TRIALS} trials "
            "at two values."
        )
    counts = [(level, [r for v, r in trials if v == level]) for level in levels]
    rows = sorted((sign * level, sum(answers), len(answers)) for level, answers in counts)
    data = np.array(rows, dtype=float)
    why = _no_threshold(data)
    if why:
        return _none(who, len(trials), standard, why)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of few blocks, which a staircase always has
        result = library.psignifit(data, experiment_type="2AFC", sigmoid="norm")
    parameters = result.parameter_estimate
    threshold = sign * float(parameters["threshold"])
    low, high = sorted(sign * float(edge) for edge in result.confidence_intervals["threshold"]["0.95"])
    if not levels[0] <= threshold <= levels[-1]:
        end, where = (levels[0], "below") if threshold < levels[0] else (levels[-1], "above")
        why = f"the threshold lies {where} {end:g}, the last value that was compared"
    elif low < levels[0] and high > levels[-1]:
        why = f"the threshold may lie anywhere between {levels[0]:g} and {levels[-1]:g}, and beyond both"
    if why:
        return _none(who, len(trials), standard, f"{why} ({_right(data)})")
    return Threshold(
        who,
        threshold,
        (low, high),
        float(parameters["width"]),
        float(parameters["lambda"]),
        len(trials),
        standard,
    )


def _none(who: tuple[str, ...], trials: int, standard: float | None, why: str) -> Threshold:
    return Threshold(who, math.nan, (math.nan, math.nan), math.nan, math.nan, trials, standard, why)


def _no_threshold(data: FloatArray) -> str:
    """Why answers show no threshold, before any fit; empty where they may.

    `data` is (values, 3): value, right answers and answers, towards the values that should be told best.
    """
    values, right, all_of_them = data.T
    # Best evidence of any number of upper values; the same of people who guess as often.
    guesses = np.random.default_rng(0).binomial(all_of_them.astype(int), 0.5, (_GUESSERS, len(data)))
    best, of_guesses = _best(right, all_of_them), _best(guesses, all_of_them)
    if np.mean(of_guesses >= best - 1e-9) > _LEVEL:
        return f"the answers are no better than chance ({_right(data)})"
    # Cochran and Armitage's test of a trend, over the order of the values.
    order = np.arange(len(data))
    share, middle = right.sum() / all_of_them.sum(), all_of_them @ order / all_of_them.sum()
    spread = share * (1 - share) * (all_of_them @ (order - middle) ** 2)
    trend = float((right - share * all_of_them) @ (order - middle))
    if trend < 0 and trend**2 > _FALLS**2 * spread:
        return (
            f"the answers become wrong towards {abs(values[-1]):g}, where they should become right "
            f"({right[0]:.0f} of {all_of_them[0]:.0f} right at {abs(values[0]):g}, "
            f"{right[-1]:.0f} of {all_of_them[-1]:.0f} at {abs(values[-1]):g})"
        )
    return ""


_FALLS = 1.64
"""Deviations of a trend from none: 5 %, one-sided."""


def _best(right: FloatArray | IntArray, of: FloatArray) -> FloatArray:
    """Most deviations (...,) from chance of the right answers (..., values) at any number of upper values."""
    upper, count = np.cumsum(right[..., ::-1], axis=-1), np.cumsum(of[::-1])
    return np.asarray(((upper - count / 2) / np.sqrt(count / 4)).max(axis=-1))


def _right(data: FloatArray) -> str:
    return f"{data[:, 1].sum():.0f} of {data[:, 2].sum():.0f} right"


# The threshold of a lab's people, from a staircase on one of its digital buttons.

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
