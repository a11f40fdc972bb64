"""Intervals for proportions of trials, and of effect sizes from noncentral distributions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy

Interval = tuple[float, float]


def wilson_interval(hits: float, total: float, level: float = 0.95) -> Interval | None:
    """Interval of a proportion of independent trials; None without trials.

    Wilson (1927): it stays within 0 to 1, and is not empty when all trials, or none, are hits.
    """
    if total <= 0:
        return None
    z = float(scipy.stats.norm.ppf(0.5 + level / 2))
    p, spread = hits / total, z * z / total
    middle = (p + spread / 2) / (1 + spread)
    half = z / (1 + spread) * math.sqrt(p * (1 - p) / total + spread / (4 * total))
    return max(0.0, middle - half), min(1.0, middle + half)


def clustered_interval(
    hits: Sequence[float], totals: Sequence[float], level: float = 0.95
) -> Interval | None:
    """Interval of a proportion whose trials come from several people, one pair (hits, trials) each.

    Trials of one person are alike, so that 300 trials of ten people say less than 300 of as many people. The
    variance of the ratio sum(hits) / sum(totals) between people (Cochran, Sampling Techniques, 1977, 6.3)
    gives the number of independent trials that would say as much, corrected for the degrees of freedom of
    the people (Korn and Graubard, 1998), and Wilson's interval is taken with that. It is never shorter than
    that of independent trials. None with fewer than two people with trials.
    """
    x, n = np.asarray(hits, dtype=float), np.asarray(totals, dtype=float)
    x, n = x[n > 0], n[n > 0]
    people = len(n)
    if people < 2:
        return None
    total = float(n.sum())
    p = float(x.sum()) / total
    variance = people / (people - 1) * float(np.sum((x - p * n) ** 2)) / total**2
    effective = min(total, p * (1 - p) / variance) if variance > 0 and 0 < p < 1 else total
    quantiles = (scipy.stats.norm.ppf(0.5 + level / 2), scipy.stats.t.ppf(0.5 + level / 2, people - 1))
    effective *= float((quantiles[0] / quantiles[1]) ** 2)
    return wilson_interval(p * effective, effective, level)


# Intervals of effect sizes, from noncentral distributions.

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
