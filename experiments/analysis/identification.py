"""Analysis of an identification experiment: confusion matrices, and what changed performance."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol, Self

import numpy as np
import numpy.typing as npt
import scipy

from ...base.arrays import FloatArray
from ...base.errors import DataError
from .anova import Comparison, Effect, anova, compare_levels
from .table import Rows, uneven_groups

Interval = tuple[float, float]
Metric = Literal["accuracy", "precision", "sensitivity"]
METRICS: tuple[Metric, ...] = ("accuracy", "precision", "sensitivity")
Counts = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Confusion:
    """Numbers of trials: rows are presented, columns answered.

    Metrics are fractions as the paper defines them: accuracy (TP + TN) / total, precision TP / (TP + FP),
    sensitivity TP / (TP + FN). Each is None where it is not defined: the precision of a class that was
    never answered, the sensitivity of one that was never presented.
    """

    classes: tuple[str, ...]
    counts: Counts
    """(classes, classes) trials."""
    people: Mapping[str, Counts]
    """The same, by participant; empty when the file does not say who answered."""

    def value(self, metric: Metric, name: str) -> float | None:
        """A metric of one class."""
        hits, total = _of(metric, self.counts, self.classes.index(name))
        return hits / total if total else None

    def interval(self, metric: Metric, name: str) -> Interval | None:
        """Interval of 95 % of a metric; over people if they are known, of independent trials otherwise."""
        index = self.classes.index(name)
        return self._interval(lambda counts: _of(metric, counts, index))

    @cached_property
    def overall(self) -> float:
        """Fraction of all trials with the right answer."""
        return float(np.trace(self.counts) / self.counts.sum())

    @property
    def overall_interval(self) -> Interval | None:
        """Interval of 95 % of `overall`, as `interval`."""
        return self._interval(lambda counts: (float(np.trace(counts)), float(counts.sum())))

    @property
    def interval_over_people(self) -> bool:
        """True when intervals count people, False when they count trials as if independent."""
        return len(self.people) > 1

    def _interval(self, of: _HitsOf) -> Interval | None:
        if not self.interval_over_people:
            return wilson_interval(*of(self.counts))
        pairs = [of(counts) for counts in self.people.values()]
        return clustered_interval([hits for hits, _ in pairs], [total for _, total in pairs])


class _HitsOf(Protocol):
    """Type of a function: hits and trials of a matrix."""

    def __call__(self, counts: Counts, /) -> tuple[float, float]: ...


def confusion_of(rows: Rows) -> Confusion:
    """Build a confusion matrix from lines of `presented`, `answered` and, if there is one, `count`.

    Without a column `count` each line is one trial. A column `participant` tells who answered. Classes are
    in the order that the file beside the table states, otherwise in that in which they are presented; one
    that is only answered comes last. Raises DataError: a missing column, an empty name, a count that is not
    a whole number, no trial at all.
    """
    rows.require("presented", "answered")
    presented, answered = rows.text("presented"), rows.text("answered")
    counts = _counts(rows)
    classes = rows.levels("presented", "answered")
    who = rows.text("participant") if "participant" in rows.columns else [""] * len(counts)
    matrices: dict[str, Counts] = {}
    for participant, row, column, count in zip(who, presented, answered, counts, strict=True):
        matrix = matrices.setdefault(participant, np.zeros((len(classes), len(classes)), dtype=np.int64))
        matrix[classes.index(row), classes.index(column)] += count
    whole = np.sum(list(matrices.values()), axis=0)
    if not whole.sum():
        raise DataError(f"{rows.name} counts no trial.")
    matrices.pop("", None)
    return Confusion(classes, whole, matrices)


def confusions_by(rows: Rows, *columns: str) -> dict[tuple[str, ...], Confusion]:
    """Confusion matrices for each combination of values of some columns, all with the same classes.

    Columns that the file does not have are left out; without any of them the result is empty.
    """
    columns = tuple(column for column in columns if column in rows.columns)
    if not columns:
        return {}
    classes = confusion_of(rows).classes
    keys = zip(*(rows.text(column) for column in columns), strict=True)
    lines: dict[tuple[str, ...], list[tuple[int, dict[str, str]]]] = {}
    for key, line in zip(keys, rows.lines, strict=True):
        lines.setdefault(key, []).append(line)
    levels = [rows.levels(column) for column in columns]
    return {
        key: _with_classes(confusion_of(replace(rows, lines=tuple(lines[key]))), classes)
        for key in itertools.product(*levels)
        if key in lines
    }


def _with_classes(confusion: Confusion, classes: tuple[str, ...]) -> Confusion:
    places = [classes.index(name) for name in confusion.classes]

    def spread(counts: Counts) -> Counts:
        whole = np.zeros((len(classes), len(classes)), dtype=np.int64)
        whole[np.ix_(places, places)] = counts
        return whole

    people = {who: spread(counts) for who, counts in confusion.people.items()}
    return Confusion(classes, spread(confusion.counts), people)


def _counts(rows: Rows) -> list[int]:
    if "count" not in rows.columns:
        return [1] * len(rows.lines)
    for (number, _), value in zip(rows.lines, rows.numbers("count"), strict=True):
        if value < 0 or value != int(value) or value > 1e9:
            raise DataError(
                f"{rows.name}, line {number}: count is {value:g}, and must be a number of trials."
            )
    return [int(value) for value in rows.numbers("count")]


def _of(metric: Metric, counts: Counts, index: int) -> tuple[float, float]:
    """Numerator and denominator of a metric."""
    true = float(counts[index, index])
    presented, answered = float(counts[index].sum()), float(counts[:, index].sum())
    total = float(counts.sum())
    match metric:
        case "accuracy":
            return total - presented - answered + 2 * true, total
        case "precision":
            return true, answered
        case "sensitivity":
            return true, presented


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

    For example:

        >>> from haploop import experiments
        >>> result = experiments.analyse_identification(experiments.read_rows("matching.csv"))
        >>> result.pooled.counts.shape  # presented by answered
        (3, 3)
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
                design = _Design.of(rows, pooled.classes, within, between)
                performance.append(_performance(rows, metric, design))
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


@dataclass(frozen=True)
class _Design:
    """What is compared: classes and a factor's levels within people, groups between them; "" for none."""

    classes: tuple[str, ...]
    within: str
    levels: tuple[str, ...]
    between: str
    group_of: Mapping[str, str]
    """Each participant's group, when people are compared."""

    @classmethod
    def of(cls, rows: Rows, classes: tuple[str, ...], within: str, between: str) -> Self:
        """Read the levels and the groups. Raises DataError for a participant in several groups."""
        levels = rows.levels(within) if within else ()
        if len(levels) < 2:
            within, levels = "", ()
        group_of: dict[str, str] = {}
        people, groups = (rows.text("participant"), rows.text(between)) if between else ((), ())
        for person, group in zip(people, groups, strict=True):
            if group_of.setdefault(person, group) != group:
                raise DataError(f"{person} is in several {between}s.")
        return cls(classes, within, levels, between, group_of)

    @property
    def factors(self) -> dict[str, tuple[str, ...]]:
        """The factors within people, and their levels, in the order of the axes of `_values`."""
        return ({self.within: self.levels} if self.within else {}) | {"class": self.classes}


def _performance(rows: Rows, metric: Metric, design: _Design) -> Performance:
    values = _values(rows, metric, design)
    whole = [person for person, of_person in values.items() if of_person is not None]
    if not whole:
        raise DataError("no participant has a defined value in each cell.")
    array = np.array([values[person] for person in whole])
    names = list(dict.fromkeys(design.group_of[person] for person in whole if design.between))
    between = design.between if len(names) > 1 else ""
    groups = tuple(names.index(design.group_of[person]) for person in whole) if between else ()
    effects = anova(array, tuple(design.factors), groups, between)  # refuses what is too little to compare
    comparisons = {
        name: compare_levels(array, axis, levels, groups)
        for axis, (name, levels) in enumerate(design.factors.items())
    }
    left_out = tuple(person for person in values if person not in whole)
    return Performance(metric, effects, comparisons, len(whole), left_out)


def _values(rows: Rows, metric: Metric, design: _Design) -> dict[str, FloatArray | None]:
    """Return each participant's values, (levels, classes) or (classes,); None where one is not defined."""
    matrices = confusions_by(rows, "participant", *([design.within] if design.within else []))
    cells = [(level,) for level in design.levels] if design.within else [()]
    values: dict[str, FloatArray | None] = {}
    for person in dict.fromkeys(rows.text("participant")):
        found = [matrices.get((person, *cell)) for cell in cells]
        table = [[one.value(metric, name) if one else None for name in design.classes] for one in found]
        defined = all(value is not None for row in table for value in row)
        values[person] = np.array(table if design.within else table[0], dtype=float) if defined else None
    return values


# Intervals of proportions of trials.


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
