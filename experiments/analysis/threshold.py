"""Psychometric functions of two-interval forced choice and staircases, fitted by psignifit."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from haploop.experiments.analysis.table import Rows
from haploop.instruments import DataError
from haploop.instruments.extras import optional

__all__ = ["Threshold", "analyse_thresholds"]

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


def analyse_thresholds(rows: Rows, by: tuple[str, ...] = ()) -> tuple[Threshold, ...]:
    """Fit the answers of each participant (and of each level of the columns `by`).

    Lines have `comparison` (the value) and `correct` (true or false); chance is one half. Raises
    ConfigurationError without psignifit, DataError: a missing column, fewer than 20 trials, fewer than two
    values.
    """
    rows.require("comparison", "correct")
    columns = tuple(name for name in ("participant", *by) if name in rows.columns)
    rows.require(*by)
    psignifit = optional("psignifit", "psychometrics", "An analysis of thresholds")
    values, right = rows.numbers("comparison"), rows.truths("correct")
    keys: list[tuple[str, ...]] = [()] * len(values)
    if columns:
        keys = list(zip(*(rows.text(column) for column in columns), strict=True))
    found = []
    for key in dict.fromkeys(keys):
        chosen = [(v, r) for v, r, k in zip(values, right, keys, strict=True) if k == key]
        found.append(_fit(psignifit, key, chosen, rows.name))
    return tuple(found)


def _fit(library: Any, who: tuple[str, ...], trials: list[tuple[float, bool]], name: str) -> Threshold:
    levels = sorted({value for value, _ in trials})
    called = " ".join(who) or name
    if len(trials) < _LEAST_TRIALS or len(levels) < 2:
        raise DataError(
            f"{called} has {len(trials)} trials at {len(levels)} values: a threshold needs "
            f"{_LEAST_TRIALS} trials "
            "at two values."
        )
    counts = [(level, [r for v, r in trials if v == level]) for level in levels]
    data = np.array([[level, sum(answers), len(answers)] for level, answers in counts], dtype=float)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of few blocks, which a staircase always has
        result = library.psignifit(data, experiment_type="2AFC", sigmoid="norm")
    parameters = result.parameter_estimate
    low, high = result.confidence_intervals["threshold"]["0.95"]
    return Threshold(
        who,
        float(parameters["threshold"]),
        (float(low), float(high)),
        float(parameters["width"]),
        float(parameters["lambda"]),
        len(trials),
    )
