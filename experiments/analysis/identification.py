"""Analysis of an identification experiment: confusion matrices, and what changed performance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...instruments import DataError
from .anova import Effect, anova
from .cells import uneven_groups
from .confusion import METRICS, Confusion, Metric, confusion_of, confusions_by
from .pairs import Comparison, compare_levels
from .table import Rows

__all__ = ["Identification", "Performance", "analyse_identification"]


@dataclass(frozen=True)
class Performance:
    """Analysis of variance of one metric, from each participant's own matrices."""

    metric: Metric
    effects: tuple[Effect, ...]
    comparisons: Mapping[str, tuple[Comparison, ...]]
    """Pairs of levels of each within factor, corrected by Bonferroni."""
    people: int
    left_out: tuple[str, ...]
    """Participants for whom the metric is not defined somewhere, or who miss a cell."""


@dataclass(frozen=True)
class Identification:
    """Result of `analyse_identification`."""

    pooled: Confusion
    by: tuple[str, ...]
    """Columns that tell the matrices apart."""
    matrices: Mapping[tuple[str, ...], Confusion]
    within: str
    between: str
    performance: tuple[Performance, ...]
    notes: tuple[str, ...]
    """Why something is missing, as sentences."""


def analyse_identification(rows: Rows, within: str = "", between: str = "") -> Identification:
    """Analyse lines of `presented`, `answered` and, if there are any, `count`, `participant`, `group`, `day`.

    Matrices are made for each group and day. With participants, each metric is analysed with the within
    factors `within` and class, and the factor `between` people; by default those are `confirmation` (else
    `day`) and `group`, where the file has such a column. Raises DataError.
    """
    by = tuple(column for column in ("group", "day") if column in rows.columns)
    pooled, matrices = confusion_of(rows), confusions_by(rows, *by)
    notes = [*rows.remarks, *_undefined(by, matrices or {(): pooled})]
    within = within or next((name for name in ("confirmation", "day") if name in rows.columns), "")
    between = between or ("group" if "group" in rows.columns else "")
    rows.require(*(name for name in (within, between) if name))
    performance: list[Performance] = []
    if not pooled.interval_over_people:
        notes.append(
            "There is no column 'participant' with several people: intervals take the trials as independent, "
            "and effects are not tested."
        )
    elif set(pooled.classes) > set(rows.text("presented")):
        notes.append("A class is answered but never presented: effects are not tested.")
    else:
        for metric in METRICS:
            try:
                performance.append(_performance(rows, metric, pooled.classes, within, between))
            except DataError as error:
                notes.append(f"Effects on {metric} are not tested: {error}")
        if between:
            pairs = set(zip(rows.text("participant"), rows.text(between), strict=True))
            notes += uneven_groups(between, [group for _, group in pairs], rows.levels(between))
    return Identification(pooled, by, matrices, within, between, tuple(performance), tuple(notes))


_WANTS: tuple[tuple[Metric, str], ...] = (("precision", "answered"), ("sensitivity", "presented"))
"""What a class must have been, for a metric of it to be defined."""


def _undefined(by: tuple[str, ...], matrices: Mapping[tuple[str, ...], Confusion]) -> Iterator[str]:
    """Say which metrics have no value, and why."""
    for key, confusion in matrices.items():
        where = "".join(f", {column} {value}" for column, value in zip(by, key, strict=True))
        for metric, never in _WANTS:
            for name in confusion.classes:
                if confusion.value(metric, name) is None:
                    yield f"Not defined{where}: the {metric} of {name}, which was never {never}."


def _performance(
    rows: Rows, metric: Metric, classes: tuple[str, ...], within: str, between: str
) -> Performance:
    levels = rows.levels(within) if within else ()
    if within and len(levels) < 2:
        levels, within = (), ""
    matrices = confusions_by(rows, "participant", *([within] if within else []))
    people = dict.fromkeys(rows.text("participant"))
    of_person = dict(zip(rows.text("participant"), rows.text(between), strict=True)) if between else {}
    if between:
        for person, group in zip(rows.text("participant"), rows.text(between), strict=True):
            if of_person[person] != group:
                raise DataError(f"{person} is in several {between}s.")
    values, whole = [], []
    for person in people:
        cells = [matrices.get((person, level)) for level in levels] if within else [matrices.get((person,))]
        table = [[cell.value(metric, name) if cell else None for name in classes] for cell in cells]
        if all(value is not None for row in table for value in row):
            values.append(table)
            whole.append(person)
    left_out = tuple(person for person in people if person not in whole)
    if not whole:
        raise DataError("no participant has a defined value in each cell.")
    array = np.array(values, dtype=float)
    factors = (within, "class") if within else ("class",)
    array = array if within else array[:, 0]
    names = tuple(dict.fromkeys(of_person[person] for person in whole)) if between else ()
    between = between if len(names) > 1 else ""
    groups = tuple(names.index(of_person[person]) for person in whole) if between else ()
    effects = anova(array, factors, groups, between)
    of_factor = (levels, classes) if within else (classes,)
    return Performance(
        metric,
        effects,
        {name: compare_levels(array, place, of_factor[place], groups) for place, name in enumerate(factors)},
        len(whole),
        left_out,
    )
