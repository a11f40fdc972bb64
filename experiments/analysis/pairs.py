"""Comparisons of pairs of levels after an analysis of variance, corrected by Bonferroni."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.arrays import FloatArray
from .effect_size import cohen_interval
from .linear import between_design


@dataclass(frozen=True)
class Comparison:
    """Difference between two levels of a factor."""

    first: str
    second: str
    difference: float
    """Mean of the first less that of the second; groups weighted alike."""
    interval: tuple[float, float]
    """Interval of 95 % of the difference, not corrected. NaN, as t, p and d, where all people differ alike:
    without a spread there is nothing to test against."""
    t: float
    df: int
    p: float
    p_bonferroni: float
    d: float
    """Standardised by the standard deviation of people's differences (Cohen's d_z)."""
    weight: float
    """Number of people whose mean difference would be known as well: less if groups differ in size."""

    @property
    def d_interval(self) -> tuple[float, float]:
        """Interval of 95 % of `d`."""
        return cohen_interval(self.t, self.df, self.weight)


def paired(first: str, second: str, differences: FloatArray, groups: Sequence[int] = ()) -> Comparison:
    """Compare two levels from each person's difference (people,), within groups if there are any.

    The spread is that within groups, so that a difference between groups is no noise.
    """
    people = len(differences)
    design = between_design(groups) if len(groups) else np.ones((people, 1))
    inverse = np.linalg.inv(design.T @ design)
    coefficients = inverse @ design.T @ differences
    df = people - design.shape[1]
    spread = math.sqrt(float(np.sum((differences - design @ coefficients) ** 2)) / df)
    mean, weight = float(coefficients[0]), 1 / float(inverse[0, 0])
    error = spread / math.sqrt(weight)
    # Rounding leaves a trace of spread where all differences are the same.
    if error <= 1e-12 * max(1.0, float(np.max(np.abs(differences)))):
        error = math.nan
    t = mean / error
    half = float(scipy.stats.t.ppf(0.975, df)) * error
    p = float(2 * scipy.stats.t.sf(abs(t), df))
    return Comparison(
        first,
        second,
        mean,
        (mean - half, mean + half),
        t,
        df,
        p,
        p,
        t / math.sqrt(weight),
        weight,
    )


def compare_levels(
    values: FloatArray, factor: int, levels: Sequence[str], groups: Sequence[int] = ()
) -> tuple[Comparison, ...]:
    """Compare all pairs of levels of a within factor, averaged over the other within factors.

    `values`: (people, levels of each within factor ...); `factor`: its index among the within factors.
    """
    rest = tuple(axis + 1 for axis in range(values.ndim - 1) if axis != factor)
    means = values.mean(axis=rest)
    found = [
        paired(levels[i], levels[j], means[:, i] - means[:, j], groups)
        for i, j in itertools.combinations(range(len(levels)), 2)
    ]
    return bonferroni(found)


def bonferroni(found: Sequence[Comparison]) -> tuple[Comparison, ...]:
    """Correct a family of comparisons: p times their number, at most 1."""
    return tuple(replace(one, p_bonferroni=min(one.p * len(found), 1.0)) for one in found)
