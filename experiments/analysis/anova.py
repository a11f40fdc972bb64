"""Analysis of variance with within factors and at most one between factor.

No Python library that is kept computes this design (two within factors and one between), so it is here, and
tested against stored results of R (car, afex).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import DataError
from .effect_size import eta_squared_interval
from .linear import between_design, products, within_contrasts


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
