"""The general linear model of repeated measures: contrasts within people, a factor between them.

Sums of squares and products are those of type III (each effect adjusted for all others, groups weighted
alike), which R's afex and SPSS print; with groups of the same size all types agree.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from ...base.arrays import FloatArray


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
