"""What several plays have in common, without their noise, and the interval of what cannot be negative.

Products of different plays are free of noise that is independent from play to play. The deviation is the
jackknife's, which for products of pairs is biased upwards, the conservative side (Efron and Stein, Annals of
Statistics 9, 1981). One rule for every power, of an error or of what is felt.
"""

from __future__ import annotations

import numpy as np
import scipy

from ..base.arrays import FloatArray, IntArray

CONFIDENCE = 0.95
"""Probability that an interval contains the surface's own value."""
LEAST_PLAYS = 3
"""Plays from which a deviation is known."""


def common(products: FloatArray) -> tuple[float, float]:
    """Mean product of different plays, and its standard deviation, from (plays, plays) products.

    Raises ValueError for fewer than three plays.
    """
    plays = len(products)
    if plays < LEAST_PLAYS:
        raise ValueError("A deviation needs at least three plays.")
    everyone = np.arange(plays)
    left_out = [_mean(products, np.delete(everyone, k)) for k in everyone]
    return _mean(products, everyone), float(np.sqrt((plays - 1) * np.var(left_out)))


def not_negative(value: float, reach: float) -> tuple[float, float]:
    """Ends of the interval of a quantity that cannot be negative, from an estimate that can.

    `reach` is half of the estimate's interval. An estimate below zero says no more than zero does, so that
    the upper end is never below `reach`. One that is further below zero than that errs by as much, and the
    upper end is as far above.
    """
    return max(value - reach, 0.0), max(max(value, 0.0) + reach, -value)


def quantile(plays: int) -> float:
    """Half of an interval over the deviation of what was estimated from so many plays."""
    return student(plays, 0.5 + CONFIDENCE / 2)


def student(plays: int, probability: float) -> float:
    """Quantile of Student's t of so many plays."""
    return float(scipy.special.stdtrit(plays - 1, probability))


def _mean(products: FloatArray, kept: IntArray) -> float:
    among = products[np.ix_(kept, kept)]
    return float((among.sum() - np.trace(among)) / (len(kept) * (len(kept) - 1)))
