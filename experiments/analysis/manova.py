"""Multivariate analysis of variance: with rows taken as independent, and with repeated measures respected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ...base.arrays import FloatArray
from .linear import between_design, products, within_contrasts


@dataclass(frozen=True)
class MultivariateEffect:
    """One effect on all variables together, by Pillai's trace."""

    name: str
    pillai: float
    f: float
    df: int
    error_df: int
    p: float
    partial_eta_squared: float
    """Pillai's trace over its largest possible value."""


def manova_independent(values: FloatArray, factors: Sequence[str]) -> tuple[MultivariateEffect | None, ...]:
    """As the paper computed it: every row (person and cell) is taken as another person's.

    `values`: (people, levels of each factor ..., variables). The error is then that of all rows around the
    means of the cells, which counts each person as often as there are cells. None for an effect that the
    number of rows does not allow.
    """
    people, *levels, variables = values.shape
    cells = int(np.prod(levels))
    flat = values.reshape(people, cells, variables)
    residual = (flat - flat.mean(axis=0)).reshape(-1, variables)
    error = residual.T @ residual
    effects = []
    for effect, contrasts in within_contrasts(levels):
        if not effect:
            continue
        means = contrasts.T @ flat.mean(axis=0)
        name = " x ".join(factors[i] for i in effect)
        effects.append(
            _pillai(name, people * means.T @ means, error, contrasts.shape[1], (people - 1) * cells)
        )
    return tuple(effects)


def manova_repeated(
    values: FloatArray, factors: Sequence[str], groups: Sequence[int] = (), between: str = ""
) -> tuple[MultivariateEffect | None, ...]:
    """In the form that respects repeated measures (doubly multivariate): the unit is the person.

    `values`: as in `manova_independent`; `groups`: as in `anova`. Each effect's contrasts of all variables
    are tested together. None for an effect with more contrasts than degrees of freedom.
    """
    people, *levels, variables = values.shape
    flat = values.reshape(people, -1, variables)
    design = between_design(groups) if between else np.ones((people, 1))
    effects = []
    for effect, contrasts in within_contrasts(levels):
        y = np.einsum("ncv,cd->ndv", flat, contrasts).reshape(people, -1)
        names = tuple(factors[i] for i in effect)
        terms = [(names, slice(0, 1))] if effect else []
        if between:
            terms.append(((between, *names), slice(1, design.shape[1])))
        for named, columns in terms:
            rank, error_df = columns.stop - columns.start, people - design.shape[1]
            effects.append(_pillai(" x ".join(named), *products(y, design, columns), rank, error_df))
    return tuple(effects)


def eta_squared_of_f(f: float, df: float, error_df: float) -> float:
    """Partial eta squared of a published F value: F df / (F df + error_df)."""
    return f * df / (f * df + error_df)


def _pillai(name: str, h: FloatArray, e: FloatArray, rank: int, error_df: int) -> MultivariateEffect | None:
    """Pillai's trace, and its F approximation (Pillai, 1955), exact for one degree of freedom."""
    variables = len(e)
    if error_df < variables or np.linalg.matrix_rank(e) < variables:
        return None
    # Eigenvalues of H (H + E)^-1 lie within 0 to 1, those of H E^-1 need not be finite.
    trace = float(np.sum(scipy.linalg.eigh(h, h + e, eigvals_only=True)))
    s = min(variables, rank)
    m, n = (abs(variables - rank) - 1) / 2, (error_df - variables - 1) / 2
    df, residual = s * (2 * m + s + 1), s * (2 * n + s + 1)
    f = residual / df * trace / (s - trace)
    return MultivariateEffect(
        name, trace, f, round(df), round(residual), float(scipy.stats.f.sf(f, df, residual)), trace / s
    )
