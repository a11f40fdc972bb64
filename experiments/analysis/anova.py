"""Analysis of variance: within factors and at most one between factor, contrasts, comparisons of pairs.

No Python library that is kept computes this design (two within factors and one between), so it is here, and
tested against stored results of R (car, afex).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import DataError

# The general linear model of repeated measures: contrasts within people, a factor between them.
#
# Sums of squares and products are those of type III (each effect adjusted for all others, groups weighted
# alike), which R's afex and SPSS print; with groups of the same size all types agree.


def within_contrasts(levels: Sequence[int]) -> Iterator[tuple[tuple[int, ...], FloatArray]]:
    """Each effect of crossed within factors: indices of its factors, and its contrasts (cells, df).

    The first is the mean over all cells, with no factor. Cells are in C order. Contrasts are orthonormal, so
    that sums of squares are those of the observations.
    """
    order = sorted(
        itertools.chain.from_iterable(
            itertools.combinations(range(len(levels)), size) for size in range(len(levels) + 1)
        ),
        key=lambda effect: (len(effect), effect),
    )
    for effect in order:
        parts = [
            _orthonormal(count) if factor in effect else np.full((count, 1), count**-0.5)
            for factor, count in enumerate(levels)
        ]
        whole: FloatArray = np.ones((1, 1))
        for part in parts:
            whole = np.asarray(np.kron(whole, part))
        yield effect, whole


def between_design(groups: Sequence[int]) -> FloatArray:
    """Design matrix (people, groups) of one between factor, by the group's number of each person.

    Columns after the first are coded to sum to zero, so that the first is the unweighted mean of the groups.
    """
    numbers = np.asarray(groups)
    count = int(numbers.max()) + 1
    coded = np.vstack([np.eye(count - 1), -np.ones((1, count - 1))])
    return np.hstack([np.ones((len(numbers), 1)), coded[numbers]])


def products(y: FloatArray, design: FloatArray, columns: slice) -> tuple[FloatArray, FloatArray]:
    """Hypothesis and error sums of squares and products (variables, variables) for columns of a design.

    `y`: (people, variables). The hypothesis is that the coefficients of these columns are zero.
    """
    inverse = np.linalg.inv(design.T @ design)
    coefficients = inverse @ design.T @ y
    residual = y - design @ coefficients
    tested = coefficients[columns]
    hypothesis = tested.T @ np.linalg.solve(inverse[columns, columns], tested)
    return hypothesis, residual.T @ residual


def _orthonormal(count: int) -> FloatArray:
    """Orthonormal contrasts (levels, levels - 1): Helmert's."""
    raw = np.array([[1.0] * k + [-float(k)] + [0.0] * (count - k - 1) for k in range(1, count)]).T
    return np.asarray(raw / np.linalg.norm(raw, axis=0))


@dataclass(frozen=True)
class Sphericity:
    """Mauchly's test of an effect with several degrees of freedom within people, and corrections."""

    mauchly_w: float
    mauchly_p: float
    greenhouse_geisser: float
    """Epsilon, by which degrees of freedom are multiplied."""
    huynh_feldt: float
    p_greenhouse_geisser: float
    """p of the effect with corrected degrees of freedom."""
    p_huynh_feldt: float


@dataclass(frozen=True)
class Effect:
    """One row of the table of an analysis of variance."""

    name: str
    factors: tuple[str, ...]
    sum_of_squares: float
    error_sum_of_squares: float
    df: int
    error_df: int
    f: float
    p: float
    """Without correction for sphericity."""
    sphericity: Sphericity | None
    """None when the effect has one degree of freedom within people, or the error is singular."""
    partial_eta_squared: float
    generalized_eta_squared: float
    """Olejnik and Algina (2003), all factors manipulated."""

    @property
    def partial_eta_squared_interval(self) -> tuple[float, float]:
        """Interval of 90 %: it excludes 0 exactly when the uncorrected p is below 0.05."""
        return eta_squared_interval(self.f, self.df, self.error_df)

    @property
    def violated(self) -> bool:
        """True when Mauchly's test rejects sphericity at 5 %."""
        return self.sphericity is not None and self.sphericity.mauchly_p < 0.05

    @property
    def reported_p(self) -> float:
        """The p to report, as in the paper: by Greenhouse and Geisser when sphericity is violated."""
        return self.sphericity.p_greenhouse_geisser if self.sphericity and self.violated else self.p


def anova(
    values: FloatArray, within: Sequence[str], groups: Sequence[int] = (), between: str = ""
) -> tuple[Effect, ...]:
    """Analyse `values` (people, levels of the first within factor, of the second, ...).

    `groups` holds the number (from 0) of each person's group in the between factor. Raises DataError: too few
    people, a factor with one level, values that do not vary.
    """
    people, *levels = values.shape
    design = between_design(groups) if between else np.ones((people, 1))
    error_df = people - design.shape[1]
    if error_df < 1 or (between and design.shape[1] < 2) or min(levels, default=2) < 2:
        raise DataError(
            f"An analysis of variance is not possible (people: {people}, groups: {design.shape[1]}): "
            "each factor needs two levels, and there must be more people than groups."
        )
    flat = values.reshape(people, -1)
    strata: list[list[_Term]] = []
    for effect, contrasts in within_contrasts(levels):
        y = flat @ contrasts
        names = tuple(within[factor] for factor in effect)
        terms = [(names, slice(0, 1))] if effect else []
        if between:
            terms.append(((between, *names), slice(1, design.shape[1])))
        # Without a between factor, people's means are an error only.
        strata.append(
            [_Term(named, *products(y, design, columns), columns) for named, columns in terms]
            or [_Term((), *products(y, design, slice(0, 1)), slice(0, 0))]
        )
    all_errors = sum(float(np.trace(stratum[0].error)) for stratum in strata)
    if all_errors <= 1e-12 * float(np.sum((flat - flat.mean()) ** 2)):
        raise DataError("The values do not vary within the cells, so nothing can be tested.")
    found = [
        _effect(term, error_df, all_errors, flat.shape[1])
        for stratum in strata
        for term in stratum
        if term.factors
    ]
    return tuple(sorted(found, key=lambda effect: len(effect.factors)))


class _Term(NamedTuple):
    """An effect's factors, its sums of products and those of its error, and its columns of the design."""

    factors: tuple[str, ...]
    hypothesis: FloatArray
    error: FloatArray
    columns: slice


def _effect(term: _Term, error_df: int, all_errors: float, cells: int) -> Effect:
    factors, h, e, columns = term
    width, rank = len(e), columns.stop - columns.start
    df, residual_df = rank * width, error_df * width
    ss, error = float(np.trace(h)), float(np.trace(e))
    f = ss / df / (error / residual_df) if error > 0 else (np.inf if ss > 0 else np.nan)
    return Effect(
        name=" x ".join(factors),
        factors=factors,
        sum_of_squares=ss,
        error_sum_of_squares=error,
        df=df,
        error_df=residual_df,
        f=f,
        p=float(scipy.stats.f.sf(f, df, residual_df)),
        sphericity=_sphericity(e, error_df, rank, f, cells) if width > 1 else None,
        partial_eta_squared=ss / (ss + error) if ss + error > 0 else np.nan,
        generalized_eta_squared=ss / (ss + all_errors),
    )


def _sphericity(e: FloatArray, n: int, rank: int, f: float, cells: int) -> Sphericity | None:
    """Mauchly (1940), p with the second term of Box's series, as in R; epsilons as in R's car.

    In that term R (`mauchly.test`, car, afex) has the number of all cells where Anderson (1958, 10.7.4) has
    that of the effect's contrasts. p differs in the fourth decimal; we follow R, so that results agree.
    """
    width, trace = len(e), float(np.trace(e))
    sign, log_det = np.linalg.slogdet(e)
    if sign <= 0 or trace <= 0 or n < width:
        return None
    log_w = float(log_det) - width * np.log(trace / width)
    rho = 1 - (2 * width**2 + width + 2) / (6 * width * n)
    weight = (width + 2) * (width - 1) * (width - 2) * (2 * width**3 + 6 * width**2 + 3 * cells + 2)
    second = weight / (288 * (n * width * rho) ** 2)
    z, freedom = -n * rho * log_w, width * (width + 1) / 2 - 1
    first_tail, second_tail = scipy.stats.chi2.sf(z, freedom), scipy.stats.chi2.sf(z, freedom + 4)
    p = first_tail + second * (second_tail - first_tail)
    gg = trace**2 / (width * float(np.sum(e * e)))
    # As car computes it, from the error's degrees of freedom, not from the number of people: Lecoutre (1991).
    hf = ((n + 1) * width * gg - 2) / (width * (n - width * gg))
    capped = min(hf, 1.0)

    def corrected(epsilon: float) -> float:
        return float(scipy.stats.f.sf(f, rank * width * epsilon, n * width * epsilon))

    return Sphericity(float(np.exp(log_w)), float(p), gg, hf, corrected(gg), corrected(capped))


# Comparisons of pairs of levels after an analysis of variance, corrected by Bonferroni.


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
        first, second, mean, (mean - half, mean + half), t, df, p, p, t / math.sqrt(weight), weight
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
