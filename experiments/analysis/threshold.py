"""Psychometric functions of two-interval forced choice and staircases, fitted by psignifit."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...instruments import DataError
from ...instruments.extras import optional
from .table import Rows

_LEAST_TRIALS = 20


@dataclass(frozen=True)
class Threshold:
    """Psychometric function of one participant, or of one and the levels of further columns."""

    who: tuple[str, ...]
    threshold: float
    """Compared value at which the answers are right half of the way from chance to the lapse rate."""
    interval: tuple[float, float]
    """95 %, Bayesian (Schuett, Harmeling, Macke and Wichmann, 2016)."""
    width: float
    """Width of the function, in the unit of the value."""
    lapse: float
    trials: int
    standard: float | None = None
    """Value that the others were compared with; None when the table does not state it."""

    @property
    def difference(self) -> float | None:
        """Just noticeable difference: from the standard to the threshold; None without a standard."""
        return None if self.standard is None else abs(self.threshold - self.standard)


def analyse_thresholds(rows: Rows, by: tuple[str, ...] = ()) -> tuple[Threshold, ...]:
    """Fit the answers of each participant (and of each level of the columns `by`).

    Lines have `comparison` (the value) and `correct` (true or false); chance is one half. With
    `first_value` and `second_value`, the other of the two is the standard. Raises ConfigurationError without
    psignifit, DataError: a missing column, fewer than 20 trials, fewer than two values, values on both sides
    of the standard.
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
    data = np.array([[sign * level, sum(answers), len(answers)] for level, answers in counts], dtype=float)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of few blocks, which a staircase always has
        result = library.psignifit(data, experiment_type="2AFC", sigmoid="norm")
    parameters = result.parameter_estimate
    low, high = sorted(sign * float(edge) for edge in result.confidence_intervals["threshold"]["0.95"])
    return Threshold(
        who,
        sign * float(parameters["threshold"]),
        (low, high),
        float(parameters["width"]),
        float(parameters["lambda"]),
        len(trials),
        standard,
    )
