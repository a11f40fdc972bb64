"""Intervals of effect sizes, from noncentral distributions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy

_LARGE = 1e4
"""|t| from which a t value's numerator counts as certain: 1e-8 of it is left out."""


def eta_squared_interval(f: float, df: float, error_df: float, level: float = 0.90) -> tuple[float, float]:
    """Interval of partial eta squared from an F value: noncentral F, Steiger (2004).

    Noncentrality lambda becomes lambda / (lambda + df + error_df + 1). For repeated measures it holds under
    sphericity.
    """
    if not math.isfinite(f):
        return (math.nan, math.nan) if math.isnan(f) else (1.0, 1.0)
    tail = (1 - level) / 2

    def bound(share: float) -> float:
        def miss(noncentrality: float) -> float:
            with np.errstate(all="ignore"):  # see below
                return float(scipy.stats.ncf.sf(f, df, error_df, noncentrality)) - share

        if float(scipy.stats.f.sf(f, df, error_df)) >= share:
            return 0.0
        if f > _LARGE**2:
            return float(f * df * scipy.stats.chi2.ppf(share, error_df) / error_df)  # as in cohen_interval
        return _root(miss, 0.0, max(10.0, f * df))

    low, high = (bound(share) for share in (tail, 1 - tail))
    total = df + error_df + 1
    return low / (low + total), high / (high + total)


def cohen_interval(t: float, df: float, people: float, level: float = 0.95) -> tuple[float, float]:
    """Interval of the standardised mean t / sqrt(people), from a t value: noncentral t.

    For two groups `people` is n1 n2 / (n1 + n2).
    """
    if not math.isfinite(t):
        return t, t
    tail = (1 - level) / 2

    def bound(share: float) -> float:
        if abs(t) > _LARGE:
            # The deviation alone is uncertain: a chi-square. scipy's noncentral t is 4 % off at 1e6.
            quantile = scipy.stats.chi2.ppf if t > 0 else scipy.stats.chi2.isf
            return t * math.sqrt(float(quantile(share, df)) / df)

        def miss(noncentrality: float) -> float:
            # scipy 1.13 warns of a division by zero on its way to the right number.
            with np.errstate(all="ignore"):
                return float(scipy.stats.nct.sf(t, df, noncentrality)) - share

        reach = abs(t) + 5 + abs(t) * 5 / math.sqrt(df)
        return float(scipy.optimize.brentq(miss, -reach, reach))

    return bound(tail) / math.sqrt(people), bound(1 - tail) / math.sqrt(people)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a rising function that is negative at `low`."""
    while function(high) < 0:
        low, high = high, 2 * high
    return float(scipy.optimize.brentq(function, low, high))
