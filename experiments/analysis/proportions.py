"""Intervals for proportions of trials, of one person or of several."""

from __future__ import annotations

import math
from collections.abc import Sequence

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
