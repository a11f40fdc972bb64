"""Analysis of ratings: normalisation, all adjective pairs together, and each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import DataError
from .anova import (
    Comparison,
    Effect,
    anova,
    between_design,
    bonferroni,
    compare_levels,
    paired,
    products,
    within_contrasts,
)
from .table import Rows, cells_of, uneven_groups


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


@dataclass(frozen=True, eq=False)
class PairRatings:
    """One adjective pair."""

    pair: str
    mean: FloatArray
    """(levels of the first factor, of the second): mean of the (normalised) ratings."""
    deviation: FloatArray
    """Their standard deviation over people."""
    effects: tuple[Effect, ...]
    comparisons: Mapping[str, tuple[Comparison, ...]]
    """Pairs of levels of each factor, corrected by Bonferroni."""
    simple: Mapping[str, tuple[Comparison, ...]]
    """Pairs of levels of the first factor at each level of the second (physical and digital of each button),
    corrected by Bonferroni over all of them."""


@dataclass(frozen=True, eq=False)
class Ratings:
    """Result of `analyse_ratings`."""

    factors: tuple[str, str]
    levels: tuple[tuple[str, ...], tuple[str, ...]]
    people: tuple[str, ...]
    left_out: tuple[str, ...]
    between: str
    normalised: bool
    pairs: tuple[PairRatings, ...]
    independent: tuple[MultivariateEffect | None, ...]
    """As the paper computed it; see `manova_independent`."""
    repeated: tuple[MultivariateEffect | None, ...]
    """By person; see `manova_repeated`."""
    notes: tuple[str, ...]


def analyse_ratings(
    rows: Rows, factors: tuple[str, str] = ("category", "button"), between: str = "", normalised: bool = True
) -> Ratings:
    """Analyse lines of `participant`, two within factors, `pair` (of adjectives) and `rating`.

    `between` names a column that differs between people; by default `group`, if there is one. Raises
    DataError: a missing column, nobody complete, a rating that cannot be normalised.

    For example:

        >>> from haploop import experiments
        >>> path = experiments.new_experiment("rating", "rating")
        >>> store = experiments.Store(experiments.load_experiment("rating"), "rating/answers")
        >>> for name in ("P01", "P02"):
        ...     somebody = haploop.mocks.SimulatedParticipant(haploop.mocks.ParticipantModel(), name, 1)
        ...     with experiments.open_session(store, name, haploop.RealClock(), simulated=True) as session:
        ...         experiments.run_session(session, somebody)
        >>> experiments.export_answers(store, "rating.csv")  # how many answers
        84
        >>> experiments.analyse_ratings(experiments.read_rows("rating.csv")).pairs[0].pair
        'Unpleasant-Pleasant'
    """
    between = between or ("group" if "group" in rows.columns else "")
    cells = cells_of(rows, [*factors, "pair"], ["rating"], between)
    values = cells.values[..., 0]
    if len(values) <= max(1, len(cells.group_names)):
        left_out = f" ({len(cells.incomplete)} did not)" if cells.incomplete else ""
        raise DataError(
            f"Of {len(values)} people who rated everything{left_out} no spread between people can be "
            "estimated: it takes one more than there are groups, and two at least."
        )
    if normalised:
        values = normalise(values, cells.people)
    groups = cells.groups if len(cells.group_names) > 1 else ()
    between = between if groups else ""
    first, second, pairs = cells.levels
    levels = (first, second)
    notes = [
        *rows.remarks,
        f"With rows taken as independent, the {values.shape[0]} participants count as "
        f"{values.shape[0] * len(first) * len(second)}, one for each cell. Ratings of one person are alike, "
        "so that this error has too many degrees of freedom, and differences between people are in it: the "
        "form by person is the one to report. Groups enter that form only.",
    ]
    repeated = manova_repeated(values, factors, groups, between) if len(pairs) > 1 else ()
    independent = manova_independent(values, factors) if len(pairs) > 1 else ()
    if between:
        notes += uneven_groups(between, [cells.group_names[one] for one in groups], cells.group_names)
    if None in repeated:
        notes.append(
            "An effect on all pairs together has as many contrasts as pairs times degrees of freedom, and "
            "needs more people than that: where it is missing, there are too few."
        )
    return Ratings(
        factors,
        levels,
        cells.people,
        cells.incomplete,
        between,
        normalised,
        tuple(
            _pair(name, values[..., index], factors, levels, groups, between)
            for index, name in enumerate(pairs)
        ),
        independent,
        repeated,
        tuple(notes),
    )


def normalise(values: FloatArray, people: Sequence[str] = ()) -> FloatArray:
    """Multiply each person's ratings by the grand geometric mean over the person's (Murray et al., 2003).

    `values`: (people, ...). Raises DataError for a rating that is not positive: its geometric mean would be
    zero, or not a number, so that the scale must begin above zero.
    """
    low = values.reshape(len(values), -1).min(axis=1)
    if np.any(low <= 0):
        who = int(np.argmin(low))
        name = people[who] if people else f"person {who + 1}"
        raise DataError(
            f"A rating of {name} is {low[who]:g}, and a geometric mean needs positive ratings: use a scale "
            "that begins above zero, or analyse the ratings as they are (--as-rated)."
        )
    logs = np.log(values)
    own = logs.reshape(len(values), -1).mean(axis=1)
    shift = (logs.mean() - own).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(np.exp(logs + shift))


def _pair(
    name: str,
    values: FloatArray,
    factors: tuple[str, str],
    levels: tuple[tuple[str, ...], tuple[str, ...]],
    groups: tuple[int, ...],
    between: str,
) -> PairRatings:
    simple = {}
    found: list[Comparison] = []
    for column, label in enumerate(levels[1]):
        simple[label] = [
            paired(levels[0][i], levels[0][j], values[:, i, column] - values[:, j, column], groups)
            for i in range(len(levels[0]))
            for j in range(i + 1, len(levels[0]))
        ]
        found += simple[label]
    corrected = iter(bonferroni(found))
    return PairRatings(
        name,
        values.mean(axis=0),
        values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1:]),
        anova(values, factors, groups, between),
        {factor: compare_levels(values, i, levels[i], groups) for i, factor in enumerate(factors)},
        {label: tuple(next(corrected) for _ in some) for label, some in simple.items()},
    )
