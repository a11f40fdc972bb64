"""Tables of cells: one value for each person and combination of levels."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import DataError
from .table import Rows


@dataclass(frozen=True, eq=False)
class Cells:
    """Values of people in crossed within factors."""

    values: FloatArray
    """(people, levels of each factor ..., variables)"""
    people: tuple[str, ...]
    factors: tuple[str, ...]
    levels: tuple[tuple[str, ...], ...]
    groups: tuple[int, ...]
    """Number of each person's group; empty without a between factor."""
    group_names: tuple[str, ...]
    incomplete: tuple[str, ...]
    """People who are left out, because a cell of theirs has no value."""


def cells_of(rows: Rows, factors: Sequence[str], variables: Sequence[str], between: str = "") -> Cells:
    """Collect the values of columns `variables` by the columns `participant`, `factors` and `between`.

    Several lines of one cell are averaged. Raises DataError: a missing column, a person in two groups, nobody
    with a value in each cell.
    """
    rows.require("participant", *factors, *variables, *([between] if between else []))
    who = rows.text("participant")
    levels = tuple(rows.levels(factor) for factor in factors)
    place = [tuple(cell) for cell in zip(*(rows.text(factor) for factor in factors), strict=True)]
    numbers = np.array([rows.numbers(variable) for variable in variables]).T
    found: dict[tuple[str, ...], list[FloatArray]] = {}
    for person, cell, line in zip(who, place, numbers, strict=True):
        found.setdefault((person, *cell), []).append(line)
    cells = list(itertools.product(*levels))
    people = tuple(dict.fromkeys(who))
    whole = tuple(person for person in people if all((person, *cell) in found for cell in cells))
    if not whole:
        raise DataError(
            f"{rows.name}: no participant has a value in each of the {len(cells)} cells of "
            f"{' x '.join(factors)}."
        )
    values = np.array([[np.mean(found[person, *cell], axis=0) for cell in cells] for person in whole])
    group_names, groups = _groups(rows, between, whole)
    return Cells(
        values.reshape(len(whole), *(len(some) for some in levels), len(variables)),
        whole,
        tuple(factors),
        levels,
        groups,
        group_names,
        tuple(person for person in people if person not in whole),
    )


def uneven_groups(between: str, of_people: Sequence[str], names: Sequence[str]) -> list[str]:
    """A note when groups differ in size: what they counterbalance is not balanced over people then."""
    counts = Counter(of_people)
    if len(set(counts.values())) < 2:
        return []
    said = ", ".join(f"{name} {counts[name]}" for name in names)
    return [
        f"The {between}s differ in size ({said} participants): what they counterbalance, such as the order "
        "of conditions, is not balanced over people."
    ]


def _groups(rows: Rows, between: str, people: Sequence[str]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    if not between:
        return (), ()
    of: dict[str, str] = {}
    for person, group in zip(rows.text("participant"), rows.text(between), strict=True):
        if of.setdefault(person, group) != group:
            raise DataError(
                f"{rows.name}: {person} is in the {between}s {of[person]} and {group}: {between} must "
                "differ between participants only."
            )
    names = tuple(dict.fromkeys(of[person] for person in people))
    return names, tuple(names.index(of[person]) for person in people)
