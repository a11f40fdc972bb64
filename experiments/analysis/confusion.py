"""Confusion matrices: what was presented, and what was answered."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from ...base.errors import DataError
from .intervals import Interval, clustered_interval, wilson_interval
from .table import Rows

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
